"""The wireframe Candide-3."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import _grimace


@dataclass(frozen=True)
class Candide3:
    """Candide-3, seen from the front."""

    neutral: npt.NDArray[np.float64]
    """Positions of the nodes in the canonical neutral face, nodes x 2, face units."""
    triangles: npt.NDArray[np.int64]
    """Nodes of each triangle, triangles x 3."""
    edges: npt.NDArray[np.int64]
    """Nodes of each edge, edges x 2."""
    live: npt.NDArray[np.int64]
    """Nodes in at least one triangle; distances are measured over these."""


@functools.lru_cache(maxsize=1)
def candide3() -> Candide3:
    """The wireframe that all functions use."""
    return Candide3(**_grimace.candide3())
