"""MPEG-4 FAP files."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from . import _grimace
from ._options import table

Path = Union[str, "os.PathLike[str]"]


@dataclass(frozen=True)
class Finding:
    """A part of a FAP file that some readers misread."""

    line: int
    """Line, from 1; the first one if there are several."""
    field: str
    """Field: ``fps``, ``mask``, ``FAP 3``, ..."""
    rule: str
    """The violated rule."""
    severity: str
    """``warning``, or ``error`` if the file cannot be read."""
    message: str
    """What was found, what was expected, and what to do."""
    times: int
    """Number of occurrences."""


@dataclass
class Fap:
    """FAP values over time."""

    name: str
    """Name in the header; one word."""
    fps: float
    """Frames per second."""
    values: npt.NDArray[np.float64]
    """Frames x 68: FAP n in column n - 1, FAPU/1024 (angles 1e-5 rad), offsets from neutral; NaN if a FAP is not set."""
    fields: list[tuple[int, int, list[int]]] = field(default_factory=list)
    """FAPs 1 and 2: frame, FAP, its integers."""
    limited: list[tuple[int, int, int]] = field(default_factory=list)
    """FAP, frame and limit of the values that were clamped to the ranges of the standard, for FAPs made from a model."""

    @classmethod
    def read(cls, path: Path) -> Fap:
        """Reads a FAP file and tolerates known deviations. Raises :class:`FapError` with line and field."""
        read = _grimace.fap_read(path)
        del read["version"]
        return cls(**read)

    @classmethod
    def from_model(cls, model: npt.ArrayLike, name: str = "expression", fps: int = 25, between: int = 5) -> Fap:
        """The FAPs of a normalized model (frames x 113 x 2, face units), as ``run`` writes them. ``between`` is the number of frames
        inserted between every two of its frames."""
        made, limited = _grimace.fap_from_model(np.ascontiguousarray(model, dtype=np.float64), name, fps, between)
        del made["version"]
        return cls(**made, limited=limited)

    def write(self, path: Path, profile: str = "strict", floats: bool = False) -> None:
        """Writes a FAP file. ``profile`` names the reader for which it is written: ``strict`` (all), ``xface``, ``greta`` or ``visage``.
        Values are rounded unless ``floats`` is true."""
        values = np.ascontiguousarray(self.values, dtype=np.float64)
        _grimace.fap_write(path, (self.name, float(self.fps)), values, self.fields, profile, floats)

    @staticmethod
    def check(path: Path) -> list[Finding]:
        """The parts of a file that some known reader misreads; empty if there are none."""
        return [Finding(**finding) for finding in json.loads(_grimace.fap_check(path))]

    @property
    def set_faps(self) -> list[int]:
        """The low-level FAPs, 3 to 68, that are set in at least one frame."""
        return [int(k) + 1 for k in np.flatnonzero(~np.isnan(self.values).all(axis=0))]

    def value(self, fap: int) -> npt.NDArray[np.float64]:
        """A FAP (3 to 68) over time."""
        if not 3 <= fap <= 68:
            raise _grimace.FapError(f"FAP {fap} is none of the low-level FAPs, 3 to 68")
        return self.values[:, fap - 1]

    def table(self) -> Any:
        """A data frame with one row per frame and one column per FAP that is set (needs pandas)."""
        return table({f"fap_{fap}": self.value(fap) for fap in self.set_faps})


