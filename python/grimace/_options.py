"""Options of the library as JSON: the defaults of a method, replaced by the given options."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping
from typing import Any, Optional, Union

from . import _grimace

Progress = Union[Callable[[int, Optional[int]], object], Any, None]


@functools.lru_cache(maxsize=None)
def _defaults(method: str) -> str:
    return _grimace.default_options(method)


def options(method: str = "default", **given: Any) -> str:
    """The options of ``method`` as JSON, replaced by the options ``given`` for the stages, except those that are None."""
    return changed(_defaults(method), given)


def changed(options: str, given: Mapping[str, Any]) -> str:
    """Options as JSON, replaced by others."""
    all_options: dict[str, Any] = json.loads(options)
    _put(all_options, given, "")
    return json.dumps(all_options, sort_keys=True)


def _put(there: dict[str, Any], given: Mapping[str, Any], at: str) -> None:
    for key, value in given.items():
        if value is None:
            continue
        if key not in there:
            raise TypeError(f"there is no option `{at}{key}`; there are {', '.join(sorted(there))}")
        if isinstance(value, Mapping) and isinstance(there[key], dict):
            _put(there[key], value, f"{at}{key}.")
        else:
            there[key] = value


def caller(progress: Progress) -> Optional[Callable[[int, Optional[int]], object]]:
    """``progress(done, total)`` unchanged; for a tqdm bar, a function that updates it."""
    if progress is None or not hasattr(progress, "refresh") or not hasattr(progress, "update"):
        return progress

    def show(done: int, total: Optional[int]) -> None:
        progress.total = total
        progress.n = done
        progress.refresh()

    return show


def table(columns: dict[str, Any]) -> Any:
    """A data frame."""
    try:
        import pandas
    except ImportError:
        raise ImportError("tables as data frames need pandas: pip install pandas") from None
    return pandas.DataFrame(columns)
