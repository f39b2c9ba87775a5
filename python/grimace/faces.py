"""Finding faces, and fitting the wireframe."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _grimace
from ._options import options

Picture = Union[str, "os.PathLike[str]", npt.ArrayLike]
"""A file, or an array of uint8: rows x columns (grey) or rows x columns x 3 (RGB)."""

NativeMarks = Union[str, list[tuple[str, float, float, bool, Optional[float]]], None]


@dataclass(frozen=True)
class Face:
    """A found face."""

    nodes: npt.NDArray[np.int64]
    """Node numbers of the points in Candide-3, one per point."""
    points: npt.NDArray[np.float64]
    """Positions, points x 2, px."""
    expected_errors: npt.NDArray[np.float64]
    """Median error expected of each point, px: half of such points are closer, half further away."""
    eye_distance: float
    """Distance between the pupils, px."""
    score: float
    """Score of the detector; faces have more than 0."""
    expected_error: float
    """Median expected error over the eye distance."""
    trusted: bool
    """Whether the points, except those of covered parts, can be used without a check."""
    covered: Sequence[str] = ()
    """Parts that are covered (`mouth`, `left eye`): their points are estimated from the rest of the face."""


Marks = Union[
    str,
    "os.PathLike[str]",
    Face,
    Mapping[Union[int, str], Sequence[float]],
    npt.ArrayLike,
    Any,
    None,
]
"""Marks on a picture: a correspondences file; a :class:`Face`; a mapping of node (0 to 112, or a feature point such as ``"8.3"``) to x, y in
px; rows ``node, x, y``; a data frame with the columns of the file (``node,x,y[,kind,expected_error]``); or None to find them."""


@dataclass(frozen=True)
class Fit:
    """The wireframe, fitted to a face."""

    nodes: npt.NDArray[np.float64]
    """Positions of all nodes, 113 x 2, px."""
    marks: list[tuple[str, float, float]]
    """The marks used by the fit: node, x, y, px."""
    residuals: npt.NDArray[np.float64]
    """Distance of each mark from its node, px."""
    warnings: list[str]
    """Warnings about the marks and the fit."""
    size: tuple[int, int]
    """Width and height of the picture, px."""
    eye_distance: float
    """Distance between the pupils, px."""
    roll: float
    """Roll of the face, degrees; positive to the subject's right."""


def native_picture(image: Picture) -> Any:
    """A picture in the form for the native module."""
    if isinstance(image, (str, os.PathLike)):
        return image
    array = np.asarray(image)
    if array.dtype != np.uint8:
        raise _grimace.InputError(f"a picture is an array of uint8 (0 to 255); this one is of {array.dtype}: scale and convert it")
    return array


def native_marks(marks: Marks) -> NativeMarks:
    """Marks in the form for the native module."""
    if marks is None:
        return None
    if isinstance(marks, (str, os.PathLike)):
        return os.fspath(marks)
    if isinstance(marks, Face):
        return [
            (str(node), float(x), float(y), False, float(error))
            for node, (x, y), error in zip(marks.nodes, marks.points, marks.expected_errors)
        ]
    if isinstance(marks, Mapping):
        return [(_node_of(node), float(place[0]), float(place[1]), False, None) for node, place in marks.items()]
    if hasattr(marks, "columns") and hasattr(marks, "itertuples"):
        return [_mark_of_row(row) for row in marks.to_dict("records")]
    rows = np.asarray(marks, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise _grimace.InputError(f"marks are rows of node, x, y; an array of shape {rows.shape} was given")
    return [(str(int(node)), float(x), float(y), False, None) for node, x, y in rows]


def _mark_of_row(row: Mapping[str, Any]) -> tuple[str, float, float, bool, Optional[float]]:
    missing = [name for name in ("node", "x", "y") if name not in row]
    if missing:
        raise _grimace.InputError(f"marks need the columns node, x, y; {', '.join(missing)} is missing, found were {', '.join(map(str, row))}")
    node, error = row["node"], row.get("expected_error")
    known = error is not None and error == error and error != ""
    if known and not float(error) > 0.0:
        raise _grimace.InputError(f"expected_error of the mark {node} is {error}; a number greater than 0 was expected")
    kind = row.get("kind", "mark")
    if kind is None or kind != kind or kind == "":
        kind = "mark"
    if kind not in ("mark", "hard"):
        raise _grimace.InputError(f"the mark {node} is of the kind {kind!r}; 'mark' or 'hard' was expected")
    return _node_of(node), float(row["x"]), float(row["y"]), kind == "hard", float(error) if known else None


def _node_of(node: Any) -> str:
    """The number of a node, or a feature point as text. As a number, 8.10 would be 8.1, which is another point."""
    if isinstance(node, (float, np.floating)):
        if not float(node).is_integer():
            raise _grimace.InputError(f"the node {node} is a number with decimals: give feature points as text, such as '8.10'")
        return str(int(node))
    return str(node)


def locate(
    image: Picture, most_faces: int = 20, least_eye_distance: Optional[float] = None, every_size: bool = False
) -> list[Face]:
    """The faces of a picture and their points, the largest face first; an empty list if there is none.

    ``least_eye_distance`` is the smallest distance between pupils to search for, px; by default a share of the picture's longer side.
    With ``every_size`` the search includes small faces beside large ones, which takes about five times as long.
    """
    return [Face(**face) for face in _grimace.locate(native_picture(image), most_faces, least_eye_distance, every_size)]


def read_marks(path: Union[str, "os.PathLike[str]"]) -> dict[int, tuple[float, float]]:
    """The marks of a correspondences file, as a mapping of node to x, y, px."""
    return {int(node): (x, y) for node, x, y, _, _ in _grimace.read_marks(path)}


def fit(image: Picture, marks: Marks = None, *, method: str = "default", prior: Optional[str] = None, force: Optional[float] = None) -> Fit:
    """Fits the wireframe to a neutral face seen from the front.

    Without ``marks``, marks are found. ``method`` is ``"default"``, or ``"kp"`` for the exact method of Krinidis and Pitas. ``prior`` is
    ``"none"``, ``"candide"``, ``"faces"`` or ``"auto"``. ``force`` is the force on a marked node divided by the stiffness of a spring.

    Raises :class:`FitError` if the marks do not determine a fit, and :class:`LocateError` if no marks are given and no reliable ones found.
    """
    fitted = _grimace.fit(native_picture(image), native_marks(marks), options(method, fit={"prior": prior, "force": force}))
    fitted["marks"] = [(node, x, y) for node, x, y, _, _ in fitted["marks"]]
    del fitted["expected_errors"]
    return Fit(**fitted)
