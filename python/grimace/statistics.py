"""Representatives, and tests between groups of people."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _grimace
from ._options import options, table

Model = npt.ArrayLike
Models = Union[Sequence[Model], Mapping[str, Union[Model, Sequence[Model]]], npt.ArrayLike]
"""Normalized models, each frames x nodes x 2 in face units: a sequence of models of different people, or a mapping of person to one or
several models."""


def _native(models: Models) -> list[tuple[str, str, npt.NDArray[np.float64]]]:
    named: list[tuple[str, str, npt.NDArray[np.float64]]] = []
    if isinstance(models, Mapping):
        for subject, of_subject in models.items():
            try:
                array = np.asarray(of_subject, dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise _grimace.InputError(f"the models of {subject} are no array of numbers, frames x nodes x 2 each: {error}") from None
            several = array[None] if array.ndim == 3 else array
            _check(several, f"of {subject}")
            named.extend((str(subject), f"{k + 1:03}", np.ascontiguousarray(model)) for k, model in enumerate(several))
    else:
        models = list(models)  # type: ignore[arg-type]
        width = len(str(len(models)))
        for k, model in enumerate(models):
            try:
                array = np.asarray(model, dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise _grimace.InputError(f"the model number {k} is no array of numbers, frames x nodes x 2: {error}") from None
            _check(array[None], f"number {k}")
            named.append((f"{k:0{width}}", "001", np.ascontiguousarray(array)))
    return named


def _check(several: npt.NDArray[np.float64], what: str) -> None:
    if several.ndim != 4 or several.shape[3] != 2:
        raise _grimace.InputError(f"the model {what} has the shape {several.shape[1:]}; frames x nodes x 2 was expected")


@dataclass(frozen=True)
class Representative:
    """The representative of models, and their distances from it."""

    model: npt.NDArray[np.float64]
    """Frames x nodes x 2, face units."""
    sequences: list[tuple[str, str]]
    """For every model, person and number of the model, sorted. Models given as a sequence are of the persons ``0``, ``1``, ..."""
    distances: npt.NDArray[np.float64]
    """Distance of every model to the representative over the fields in which it was kept, face units; NaN if it was trimmed from all."""
    dispersion: Optional[float]
    """Median of the distances, face units; None for a single model."""
    dispersion_untrimmed: Optional[float]
    """The same before trimming: distances of all models to the median of all."""
    node_dispersion: npt.NDArray[np.float64]
    """Dispersion of every node, face units."""
    trimming: list[tuple[int, str, str, float, bool]]
    """Field, person, number, sum of distances, whether it was dropped."""
    sums: dict[str, float]
    """Sums of distances of both medians (``greedy``, ``exact``), the ``lower_bound``, and the gaps as ratios."""
    search: dict[str, Any]
    """How both searches ended."""
    weighted: bool
    """Whether people had different numbers of models, so that each person weighs the same."""

    def trimming_table(self) -> Any:
        """A data frame ``field,subject,sequence,distance,dropped`` (needs pandas)."""
        columns = list(zip(*self.trimming)) or [[]] * 5
        return table(dict(zip(("field", "subject", "sequence", "distance", "dropped"), columns)))


def representative(
    models: Models,
    alpha: float = 0.1,
    median: str = "greedy",
    *,
    trim: Optional[str] = None,
    weight: Optional[str] = None,
    emotion: str = "expression",
) -> Representative:
    """The representative of normalized models: their trimmed generalized median.

    ``alpha`` is the share of models trimmed from each displacement field, at least 0 and less than 0.5; ``median`` is ``"greedy"`` or
    ``"exact"``; both are computed, and ``sums`` has the gap. ``trim`` is ``"frame"`` or ``"model"``, ``weight`` ``"person"`` or
    ``"sequence"``.

    Raises :class:`StatisticsError` if there are no models, if their shapes or neutral frames differ, or if alpha is out of range.
    """
    chosen = options(statistics={"alpha": alpha, "median": median, "trim": trim, "weighting": weight})
    found = _grimace.representative(_native(models), emotion, chosen)
    found["sums"] = json.loads(found["sums"])
    found["search"] = json.loads(found["search"])
    return Representative(**found)


@dataclass(frozen=True)
class Comparison:
    """Comparison of two groups of people: a permutation test on the energy distance."""

    groups: tuple[str, str]
    """Names of the groups."""
    people: tuple[int, int]
    """Number of people in each group."""
    sequences: tuple[int, int]
    """Number of models in each group."""
    not_tested: Optional[str]
    """Reason why there is no test; the numbers below are NaN in that case."""
    energy: float
    """Energy distance, face units."""
    effect: float
    """Effect size H, 0 to 1."""
    effect_by_chance: float
    """Effect by chance: 95 of 100 random splits have a smaller effect."""
    p: float
    """p of the energy distance."""
    p_adjusted: float
    """p after Holm's correction over all pairs."""
    p_either_adjusted: float
    """p of the whole face or the clearest node, after Holm's correction; it decides the verdict."""
    least_p: float
    """The smallest p that groups of this size can reach."""
    permutations: int
    """Number of splits tried."""
    node_p: npt.NDArray[np.float64]
    """p of every live node (``candide3().live``), corrected for the number of nodes."""


def compare(
    groups: Mapping[str, Models],
    *,
    permutations: int = 9999,
    people: int = 200,
    significance: float = 0.05,
    seed: int = 1,
    emotion: str = "expression",
) -> list[Comparison]:
    """Tests whether groups of people make an expression differently: every pair of groups, corrected for the number of tests.

    ``groups`` maps names to models in the form that :func:`representative` accepts. In a sequence, each model is of a different person. In
    mappings, the same name is the same person; groups that share people cannot be tested. ``people`` is the largest number of people of
    a group that a test uses, and ``seed`` is the seed of all random draws.

    Raises :class:`StatisticsError` if the models cannot be compared.
    """
    named = []
    for name, models in groups.items():
        native = _native(models)
        if not isinstance(models, Mapping):
            native = [(f"{name}:{subject}", sequence, model) for subject, sequence, model in native]
        if not native:
            raise _grimace.StatisticsError(f"the group `{name}` has no models")
        named.append((str(name), native))
    settings = (permutations, people, seed, significance)
    return [_comparison(c) for c in json.loads(_grimace.compare(named, emotion, settings, options()))]


def _comparison(found: dict[str, Any]) -> Comparison:
    tested: Optional[dict[str, Any]] = found["outcome"].get("Ok")
    names = ("energy", "effect", "effect_by_chance", "p", "p_adjusted", "p_either_adjusted", "least_p")
    numbers = {name: float("nan") if tested is None else tested[name] for name in names}
    return Comparison(
        groups=tuple(group["group"] for group in found["groups"]),  # type: ignore[arg-type]
        people=tuple(found["people"]),  # type: ignore[arg-type]
        sequences=tuple(found["sequences"]),  # type: ignore[arg-type]
        not_tested=found["reason"] if tested is None else None,
        permutations=0 if tested is None else tested["permutations"],
        node_p=np.array([] if tested is None else tested["node_p"]),
        **numbers,
    )
