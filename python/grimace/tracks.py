"""Tracks and normalized models."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _grimace
from ._options import Progress, caller, options, table
from .faces import Marks, Picture, native_marks, native_picture

Path = Union[str, "os.PathLike[str]"]


class Track:
    """A tracked sequence with the neutral frame first, as returned by :func:`track`."""

    def __init__(self, native: _grimace.Track) -> None:
        self._native = native

    @classmethod
    def read(cls, path: Path) -> Track:
        """Reads a track file (``.csv``), and the ``.json`` beside it if there is one."""
        return cls(_grimace.Track.read(path))

    def write(self, path: Path) -> None:
        """Writes the track (``.csv``) and, beside it, its options and inputs (``.json``). A name SUBJECT_SEQUENCE.csv gives subject and sequence."""
        self._native.write(path)

    @property
    def positions(self) -> npt.NDArray[np.float64]:
        """Positions of all nodes, frames x nodes x 2, px."""
        return self._native.positions

    @property
    def numbers(self) -> npt.NDArray[np.int64]:
        """Frame numbers, as in the file names, or from 1."""
        return self._native.numbers

    @property
    def states(self) -> npt.NDArray[np.str_]:
        """Source of every position, frames x nodes: ``marked``, ``fitted``, ``tracked``, ``recovered_...``, ``follows``."""
        return np.array(self._native.states)

    @property
    def residuals(self) -> npt.NDArray[np.float64]:
        """Residuals, frames x nodes, px: distance to the mark in the neutral frame, later the forward-backward distance of KLT; NaN if there is none."""
        return self._native.residuals

    @property
    def expected_errors(self) -> npt.NDArray[np.float64]:
        """Median expected errors, frames x nodes, px: of the position on the face in the neutral frame, of the motion later; NaN if unknown."""
        return self._native.expected_errors

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the frames, px."""
        return self._native.size

    @property
    def info(self) -> dict[str, Any]:
        """Options, marks, frame rate, and a ``summary`` with the verdict; empty if unknown."""
        text = self._native.info
        return {} if text is None else json.loads(text)

    def table(self) -> Any:
        """A data frame ``frame,node,x,y,state,residual,expected_error`` (needs pandas)."""
        positions = self.positions
        frames, nodes = positions.shape[:2]
        return table(
            {
                "frame": np.repeat(self.numbers, nodes),
                "node": np.tile(np.arange(nodes), frames),
                "x": positions[..., 0].ravel(),
                "y": positions[..., 1].ravel(),
                "state": self.states.ravel(),
                "residual": self.residuals.ravel(),
                "expected_error": self.expected_errors.ravel(),
            }
        )

    def __len__(self) -> int:
        return len(self.numbers)

    def __repr__(self) -> str:
        return f"<grimace.Track of {len(self)} frames, {self.size[0]}x{self.size[1]}>"


def track(
    frames: Union[Path, Iterable[Picture]],
    marks: Marks = None,
    *,
    first_frame: Optional[int] = None,
    last_frame: Optional[int] = None,
    fps: Optional[float] = None,
    subject: str = "subject",
    sequence: str = "sequence",
    emotion: str = "unlabelled",
    method: str = "default",
    fit: Optional[dict[str, Any]] = None,
    track: Optional[dict[str, Any]] = None,
    progress: Progress = None,
) -> Track:
    """Fits the wireframe to the first frame (neutral) and tracks it to the last (apex).

    ``frames`` is a folder of images, a video (which needs ``grimace-opencv`` on PATH), or pictures in order, for example an array frames x
    rows x columns x 3 of uint8. Without ``marks``, marks are found in the first frame. ``first_frame`` and ``last_frame`` are the numbers in
    the file names. ``fit`` and ``track`` change single options of these stages, with the names in the ``info`` of a track.
    ``progress(done, total)`` is called while frames are tracked; a tqdm bar is accepted, too.

    Raises :class:`InputError`, :class:`LocateError`, :class:`FitError` or :class:`TrackError`, depending on the stage that failed.
    """
    folder, pictures = None, None
    if isinstance(frames, (str, os.PathLike)):
        folder = frames
    else:
        pictures = [native_picture(frame) for frame in frames]
        if first_frame is not None or last_frame is not None:
            raise TypeError("first_frame and last_frame are for files; of pictures give those that count")
    return Track(
        _grimace.track(
            folder,
            pictures,
            native_marks(marks),
            (first_frame, last_frame),
            fps,
            (subject, sequence, emotion),
            options(method, fit=fit, track=track),
            caller(progress),
        )
    )


def normalize(
    track: Union[Track, Path, npt.ArrayLike],
    *,
    resample: Optional[str] = None,
    size: Optional[str] = None,
    pose: Optional[str] = None,
    irisd: Optional[str] = None,
    method: str = "default",
) -> npt.NDArray[np.float64]:
    """The normalized model of a track: five frames from neutral to apex, 5 x 113 x 2, face units, without head motion.

    ``resample`` is ``"nearest"`` or ``"linear"``, ``size`` ``"fapu"`` or ``"uniform"``, ``pose`` ``"full"`` or ``"roll"``. ``irisd`` is
    ``"lids"`` or ``"boxes"``: where the unit of the eyes' motion is measured. For positions given as an array (frames x 113 x 2, px), only
    the roll is removed, because yaw and pitch cannot be computed from them.

    Raises :class:`NormalizeError` for a motion that is impossible for a face.
    """
    chosen = options(method, normalize={"resample": resample, "size": size, "pose": pose, "irisd": irisd})
    if isinstance(track, (str, os.PathLike)):
        track = Track.read(track)
    if isinstance(track, Track):
        return _grimace.normalize(track._native, chosen)
    if pose == "full":
        raise TypeError('pose="full" needs a Track; of positions alone the roll is taken out')
    return _grimace.normalize_positions(np.ascontiguousarray(track, dtype=np.float64), chosen)


def read_model(path: Path) -> npt.NDArray[np.float64]:
    """A normalized model or representative from a file ``frame,node,x,y``: frames x nodes x 2, face units."""
    return _grimace.read_model(path)


def write_model(path: Path, model: npt.ArrayLike) -> None:
    """Writes a normalized model, frames x nodes x 2, face units, as a file ``frame,node,x,y``."""
    _grimace.write_model(path, np.ascontiguousarray(model, dtype=np.float64))
