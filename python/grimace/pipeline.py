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
"""First characters of texts that a spreadsheet reads as formulas."""


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
        """``run.json``: the options and inputs of the run."""
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
        # A group may have the name None, and a person the name NA, so only empty fields are missing values. A leading apostrophe prevents
        # spreadsheets from reading a text as a formula.
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
        """The track of SUBJECT_SEQUENCE."""
        return Track.read(self.folder / "tracks" / f"{name}.csv")

    def fap(self, emotion: str) -> Fap:
        """The FAP file of an emotion."""
        return Fap.read(self.folder / "fap" / f"{emotion}.fap")


@dataclass(frozen=True)
class RunSummary:
    """Summary of a run."""

    sequences: int
    """Number of sequences in the dataset."""
    tracked: int
    """Number of sequences tracked in this run."""
    reused: int
    """Number of sequences unchanged since an earlier run."""
    failures: list[Failure]
    """Failed sequences, each with the reason."""
    skipped: list[tuple[str, str]]
    """Sequences left out on purpose, with the reason."""
    representatives: list[tuple[str, int]]
    """Name and number of sequences of every representative."""
    warnings: list[str]
    """Warnings and notes for the user."""
    unchanged: bool
    """Whether nothing had changed, so that nothing was written."""
    results: Results
    """The folder of the results."""


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
    """Runs every stage over a dataset into the folder ``out``, as ``grimace run`` does. A second call continues an interrupted run.

    ``by`` names columns of the manifest to group by. ``strata`` names columns within whose values people are permuted. ``covariates`` names
    columns of numbers, such as age, with which expressions may change. ``alpha`` and ``median`` are those of :func:`representative`;
    ``resample``, ``size``, ``pose`` and ``irisd`` are those of :func:`normalize`. ``no_faces`` leaves pictures of people out of the report.
    ``overlay`` names a folder for pictures of the wireframe. ``change`` changes any other option, with the names and nesting of ``options``
    in ``run.json``. ``progress(done, total)`` counts sequences.

    Single failed sequences are in :attr:`RunSummary.failures` and raise nothing. Raises :class:`RunError` if there is no result.
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
