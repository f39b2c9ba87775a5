import pathlib

import numpy as np
import pytest

import grimace

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def sample():
    """The simulated sample of the repository."""
    return ROOT / "fixtures" / "simulated"


@pytest.fixture(scope="session")
def portrait():
    return ROOT / "fixtures" / "portraits" / "P01.jpg"


@pytest.fixture(scope="session")
def smile(sample):
    """A tracked smile, from the marks beside its frames."""
    folder = sample / "S001" / "005"
    return grimace.track(folder, folder / "correspondences.csv", emotion="happiness")


@pytest.fixture(scope="session")
def models():
    """Models that differ only in strength: mouth corners (nodes 31 and 64) that move out and up."""
    neutral = grimace.candide3().neutral

    def model(strength):
        frames = np.repeat(neutral[None], 5, axis=0)
        share = strength * np.arange(5)[:, None] / 4
        frames[:, 31] += share * [50, 50]
        frames[:, 64] += share * [-50, 50]
        return frames

    return model
