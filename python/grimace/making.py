"""Expressions on new faces and on dense meshes."""

from __future__ import annotations

import json
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _grimace
from ._options import Progress, caller, options
from .faces import Marks, Picture, native_marks, native_picture
from .fap import Fap
from .statistics import Representative
from .tracks import Track, write_model

Path = Union[str, "os.PathLike[str]"]
Motion = Union[Path, Track, Representative, Fap, npt.ArrayLike]
"""A motion: a file (track, model, representative, ``.fap``), a :class:`Track`, a :class:`Representative`, a :class:`Fap`, or a normalized
model, frames x 113 x 2, face units."""


@dataclass(frozen=True)
class Clone:
    """An expression on a face."""

    frames: npt.NDArray[np.uint8]
    """Pictures, frames x rows x columns x 3, RGB."""
    nodes: npt.NDArray[np.float64]
    """Positions of the nodes, frames x 113 x 2, px."""
    fps: float
    """Frames per second."""
    apex: int
    """The frame farthest from neutral."""


def clone(
    source: Motion,
    image: Picture,
    marks: Marks = None,
    *,
    rescale: Optional[str] = None,
    emphasis: Optional[float] = None,
    head: bool = False,
    teeth: Optional[str] = None,
    fps: Optional[float] = None,
    duration: Optional[float] = None,
    ease: Optional[str] = None,
    back: bool = False,
    prior: Optional[str] = None,
    progress: Progress = None,
) -> Clone:
    """Puts an expression on a neutral photograph, in the proportions of its face.

    Without ``marks``, marks are found. ``rescale`` is ``"fapu"``, ``"uniform"`` or ``"none"``. ``emphasis`` is a factor on the motion.
    ``head`` adds the head motion of a track. ``teeth`` is ``"auto"``, ``"dark"`` or ``"drawn"``. ``fps`` is in frames per second,
    ``duration`` in seconds. ``ease`` is ``"linear"``, ``"in"``, ``"out"`` or ``"in-out"``. ``back`` returns to neutral. All frames are held
    in memory, with 3 bytes per pixel.

    Raises :class:`CloneError` if the picture or the marks cannot be used.
    """
    given = {
        "rescale": rescale,
        "emphasis": emphasis,
        "head": head,
        "teeth": teeth,
        "timing": _given({"fps": fps, "duration": duration, "ease": ease, "back": back}),
    }
    return Clone(
        **_grimace.clone(
            _native_motion(source),
            native_picture(image),
            native_marks(marks),
            json.dumps(_given(given)),
            options(fit={"prior": prior}),
            caller(progress),
        )
    )


@dataclass(frozen=True)
class Synthesis:
    """A motion, shown by a bank of expression meshes."""

    surface: npt.NDArray[np.float32]
    """Displacements from neutral, frames x vertices x 3, in the unit of the bank."""
    neutral: npt.NDArray[np.float32]
    """The neutral mesh, vertices x 3."""
    triangles: npt.NDArray[np.int64]
    """Vertices of each triangle, triangles x 3."""
    weights: npt.NDArray[np.float64]
    """Weights, frames x regions x members."""
    members: list[str]
    """Names of the bank's members."""
    fitness: npt.NDArray[np.float64]
    """Mean cosine between requested and shown motion of the feature points by frame, -1 to 1; NaN if nothing moves."""
    shown: npt.NDArray[np.float64]
    """Share of the requested motion that is shown, by frame: motion of the feature points along the requested directions over the requested
    distance; NaN if nothing moves."""
    share_of_bound: npt.NDArray[np.float64]
    """Fitness by frame, divided by the best that the bank allows; NaN if there is no bound."""
    fps: float
    """Frames per second."""


def synthesize(
    motion: Motion,
    bank: Path = "head",
    *,
    solver: Optional[str] = None,
    regions: Optional[str] = None,
    emphasis: Optional[float] = None,
    seed: Optional[int] = None,
    smooth: Optional[float] = None,
    between: Optional[int] = None,
    noise: Optional[float] = None,
    fps: Optional[float] = None,
    scale: Optional[float] = None,
    gltf: Optional[Path] = None,
    progress: Progress = None,
    **search: Any,
) -> Synthesis:
    """Finds the mixture of the expression meshes of a bank whose feature points move as in the motion.

    ``motion`` may also be a file of feature points, ``frame,fp,dx,dy,dz``. ``bank`` is a bank file, or ``"head"`` or ``"candide"`` for an
    embedded one. ``solver`` is ``"best"``, ``"rbf"``, ``"nnls"``, ``"ga"``, ``"refined"`` (default) or ``"cosine"``. ``regions`` is
    ``"whole"``, ``"halves"`` or ``"quarters"``. ``smooth`` is the width of the smoothing in frames. ``between`` is the number of frames
    inserted between every two of the motion (5 for models). ``noise`` is the share of the largest motion that counts as rest. ``scale`` is
    in bank units per face unit. ``gltf`` names a file to which the animation is also written. The options of the genetic algorithm are
    ``generations``, ``population``, ``tournament`` and ``runs``.

    Raises :class:`SynthesisError`.
    """
    unknown = sorted(set(search) - {"generations", "population", "tournament", "runs"})
    if unknown:
        raise TypeError(f"there is no option `{unknown[0]}`; there are generations, population, tournament, runs")
    chosen = {
        "solver": solver,
        "regions": regions,
        "emphasis": emphasis,
        "smoothing_frames": smooth,
        "ga": _given({"seed": seed, **search}),
    }
    with tempfile.TemporaryDirectory(prefix="grimace-") as folder:
        return Synthesis(
            **_grimace.synthesize(
                _motion_file(motion, FilePath(folder)),
                bank,
                (between, noise),
                (fps, scale),
                json.dumps(_given(chosen)),
                gltf,
                caller(progress),
            )
        )


def _given(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _native_motion(motion: Motion) -> Any:
    if isinstance(motion, (str, os.PathLike)):
        return motion
    if isinstance(motion, Track):
        return motion._native
    if isinstance(motion, Fap):
        return np.ascontiguousarray(motion.values, dtype=np.float64), float(motion.fps)
    if isinstance(motion, Representative):
        motion = motion.model
    return np.ascontiguousarray(motion, dtype=np.float64)


def _motion_file(motion: Motion, folder: FilePath) -> Path:
    """The motion as a file for the synthesis."""
    if isinstance(motion, (str, os.PathLike)):
        return motion
    if isinstance(motion, Track):
        path = folder / "motion_track.csv"
        motion.write(path)
    elif isinstance(motion, Fap):
        path = folder / "motion.fap"
        motion.write(path, profile="xface", floats=True)
    else:
        path = folder / "motion.csv"
        write_model(path, motion.model if isinstance(motion, Representative) else motion)
    return path
