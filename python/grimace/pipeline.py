"""The main job: every stage over a dataset."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _grimace
from ._options import Progress, caller, changed, options
from .fap import Fap
from .tracks import Track, read_model

_FORMULA = "=+-@\t\r\n\uff1d\uff0b\uff0d\uff20"
"""First characters of what a spreadsheet takes for a formula."""


def _without_apostrophe(text: Any) -> Any:
    if isinstance(text, str) and text.startswith("'"):
        rest = text.lstrip("'")
        if len(rest) > 1 and rest[0] in _FORMULA:
            return text[1:]
    return text


Path = Union[str, "os.PathLike[str]"]


@dataclass(frozen=True)
class Failure:
    """A sequence that failed."""

    subject: str
    sequence: str
    stage: str
    reason: str


class Results:
    """The folder of a run: its tables, models and files."""

    def __init__(self, folder: Path) -> None:
        self.folder = FilePath(folder)
        if not (self.folder / "run.json").is_file():
            raise _grimace.InputError(f"{self.folder}: no run.json; give the folder that a run wrote")

    @property
    def record(self) -> dict[str, Any]:
        """``run.json``: what was made from what."""
        return json.loads((self.folder / "run.json").read_text(encoding="utf-8"))

    def table(self, name: str) -> Any:
        """A table such as ``"statistics"``, ``"trimming"``, ``"amplitudes"`` or ``"comparisons"`` as a data frame (needs pandas)."""
        try:
            import pandas
        except ImportError:
            raise ImportError("tables as data frames need pandas: pip install pandas") from None
        path = self.folder / f"{name}.csv"
        if not path.is_file():
            there = sorted(p.stem for p in self.folder.glob("*.csv"))
            raise _grimace.InputError(f"{path}: there is no such table; there are {', '.join(there)}")
        # A group may be called None, a person NA; what is empty is missing, and nothing else. An apostrophe keeps spreadsheets from taking a
        # text for a formula.
        frame = pandas.read_csv(path, dtype={"subject": str, "sequence": str, "id": str}, keep_default_na=False, na_values=[""])
        for column in frame.columns:
            if not pandas.api.types.is_numeric_dtype(frame[column]):
                frame[column] = frame[column].map(_without_apostrophe)
        return frame

    def units(self) -> dict[str, Any]:
        """The unit of every column of every table."""
        return json.loads((self.folder / "units.json").read_text(encoding="utf-8"))

    def representative(self, emotion: str) -> npt.NDArray[np.float64]:
        """The representative of an emotion, or of an emotion and a group: frames x 113 x 2, face units."""
        return read_model(self.folder / "representatives" / f"{emotion}.csv")

    def models(self) -> dict[str, npt.NDArray[np.float64]]:
        """Every normalized model by SUBJECT_SEQUENCE, frames x 113 x 2, face units."""
        return {path.stem: read_model(path) for path in sorted((self.folder / "models").glob("*.csv"))}

    def track(self, name: str) -> Track:
        """The track SUBJECT_SEQUENCE."""
        return Track.read(self.folder / "tracks" / f"{name}.csv")

    def fap(self, emotion: str) -> Fap:
        """The FAP file of an emotion."""
        return Fap.read(self.folder / "fap" / f"{emotion}.fap")


@dataclass(frozen=True)
class RunSummary:
    """What a run did."""

    sequences: int
    """Sequences of the dataset."""
    tracked: int
    """Tracked in this run."""
    reused: int
    """Unchanged since an earlier run."""
    failures: list[Failure]
    """Those that failed, each with its reason."""
    skipped: list[tuple[str, str]]
    """Left out on purpose, with the reason."""
    representatives: list[tuple[str, int]]
    """Name and number of sequences of every representative."""
    warnings: list[str]
    """What a person should read."""
    unchanged: bool
    """Nothing had changed: nothing was written."""
    results: Results
    """The folder."""


def run(
    dataset: Path,
    out: Path,
    *,
    by: Union[str, Sequence[str]] = (),
    strata: Union[str, Sequence[str]] = (),
    covariates: Union[str, Sequence[str]] = (),
    method: str = "default",
    alpha: Optional[float] = None,
    median: Optional[str] = None,
    resample: Optional[str] = None,
    size: Optional[str] = None,
    pose: Optional[str] = None,
    irisd: Optional[str] = None,
    no_faces: bool = False,
    overlay: Optional[Path] = None,
    force: bool = False,
    change: Optional[dict[str, Any]] = None,
    progress: Progress = None,
) -> RunSummary:
    """Runs every stage over a dataset into the folder ``out``, as ``grimace run`` does; interrupted or called again, it goes on.

    ``by`` names columns of the manifest to group by, ``strata`` those within whose values people are permuted, ``covariates`` those
    of numbers with which expressions may go. ``alpha`` and ``median`` are
    those of :func:`representative`, ``resample``, ``size``, ``pose`` and ``irisd`` those of :func:`normalize`. ``no_faces`` leaves pictures of people
    out of the report, ``overlay`` names a folder for pictures of the wireframe. ``change`` changes any other option, named and nested as
    ``options`` in ``run.json``. ``progress(done, total)`` is told sequences.

    Single sequences that fail are not errors but :attr:`RunSummary.failures`. Raises :class:`RunError` where nothing came out.
    """
    chosen = options(
        method,
        **{
            "by": _columns(by),
            "strata": _columns(strata),
            "covariates": _columns(covariates),
            "statistics": {"alpha": alpha, "median": median},
            "normalize": {"resample": resample, "size": size, "pose": pose, "irisd": irisd},
            "no_faces": True if no_faces else None,
        },
    )
    if change:
        chosen = changed(chosen, change)
    summary = _grimace.run(dataset, out, overlay, force, chosen, caller(progress))
    summary["failures"] = [Failure(*failure) for failure in summary["failures"]]
    return RunSummary(**summary, results=Results(out))


def _columns(names: Union[str, Sequence[str]]) -> Optional[list[str]]:
    return ([names] if isinstance(names, str) else list(names)) or None
