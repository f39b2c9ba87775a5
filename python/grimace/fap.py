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
    """Something in a FAP file that not every reader takes as it is meant."""

    line: int
    """Line, from 1; the first, where it happens more than once."""
    field: str
    """What it is about: ``fps``, ``mask``, ``FAP 3``, ..."""
    rule: str
    """The rule that is broken."""
    severity: str
    """``warning``, or ``error`` where the file does not read."""
    message: str
    """What was found, what was expected, what to do."""
    times: int
    """How often it happens."""


@dataclass
class Fap:
    """FAP values over time."""

    name: str
    """Name in the header; one word."""
    fps: float
    """Frames per second."""
    values: npt.NDArray[np.float64]
    """Frames x 68: FAP n in column n - 1, FAPU/1024 (angles 1e-5 rad), offsets from neutral; NaN where a FAP is not set."""
    fields: list[tuple[int, int, list[int]]] = field(default_factory=list)
    """FAPs 1 and 2: frame, FAP, its integers."""
    limited: list[tuple[int, int, int]] = field(default_factory=list)
    """FAP, frame and limit of values that the standard's ranges limited, of FAPs made from a model."""

    @classmethod
    def read(cls, path: Path) -> Fap:
        """Reads a FAP file, tolerantly. Raises :class:`FapError` with line and field."""
        read = _grimace.fap_read(path)
        del read["version"]
        return cls(**read)

    @classmethod
    def from_model(cls, model: npt.ArrayLike, name: str = "expression", fps: int = 25, between: int = 5) -> Fap:
        """The FAPs of a normalized model (frames x 113 x 2, face units), ``between`` frames put between every two of its frames: what
        ``run`` writes."""
        made, limited = _grimace.fap_from_model(np.ascontiguousarray(model, dtype=np.float64), name, fps, between)
        del made["version"]
        return cls(**made, limited=limited)

    def write(self, path: Path, profile: str = "strict", floats: bool = False) -> None:
        """Writes a FAP file. ``profile`` is the reader that it is for: ``strict`` (all of them), ``xface``, ``greta`` or ``visage``. Values
        are rounded, unless ``floats`` is asked for."""
        values = np.ascontiguousarray(self.values, dtype=np.float64)
        _grimace.fap_write(path, (self.name, float(self.fps)), values, self.fields, profile, floats)

    @staticmethod
    def check(path: Path) -> list[Finding]:
        """What in a file is not as every known reader takes it; empty where all is well."""
        return [Finding(**finding) for finding in json.loads(_grimace.fap_check(path))]

    @property
    def set_faps(self) -> list[int]:
        """Low-level FAPs that any frame sets, 3 to 68."""
        return [int(k) + 1 for k in np.flatnonzero(~np.isnan(self.values).all(axis=0))]

    def value(self, fap: int) -> npt.NDArray[np.float64]:
        """A FAP (3 to 68) over time."""
        if not 3 <= fap <= 68:
            raise _grimace.FapError(f"FAP {fap} is none of the low-level FAPs, 3 to 68")
        return self.values[:, fap - 1]

    def table(self) -> Any:
        """A data frame with a row for each frame and a column for each FAP that is set (needs pandas)."""
        return table({f"fap_{fap}": self.value(fap) for fap in self.set_faps})


