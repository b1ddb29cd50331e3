"""Load tables: the rows of all loads on a mechanism."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import InvalidInput
from rollingjoint.load.columns import LOAD_COLUMNS, SPATIAL_LOAD_COLUMNS
from rollingjoint.load.kinds import LOADS, Load, Row, in_words

_PLACES, _SPATIAL_PLACES = (
    {name: place for place, name in enumerate(columns)} for columns in (LOAD_COLUMNS, SPATIAL_LOAD_COLUMNS)
)
_LISTS = (list, tuple)  # isinstance takes four times as long with list | tuple


def load_table(loads: Sequence[Load], n_links: int) -> NDArray[np.float64]:
    """Rows of LOAD_COLUMNS for the loads, (rows, columns).

    Raises:
        InvalidInput: no list of loads, a link that does not exist, a wrong number of weights or coordinates, text.
    """
    return _table(loads, _PLACES, lambda load: load.rows(n_links))


def spatial_load_table(loads: Sequence[Load], n_links: int) -> NDArray[np.float64]:
    """Rows of SPATIAL_LOAD_COLUMNS for the loads on a spatial chain, (rows, columns).

    Raises:
        InvalidInput: as load_table.
    """
    return _table(loads, _SPATIAL_PLACES, lambda load: load.spatial_rows(n_links))


def _table(
    loads: Sequence[Load], places: Mapping[str, int], rows_of: Callable[[Load], list[Row] | NDArray[np.float64]]
) -> NDArray[np.float64]:
    if not isinstance(loads, _LISTS) and (isinstance(loads, Load) or not isinstance(loads, Iterable)):
        raise InvalidInput("loads", loads, "a list of loads, such as [WorldForce(-1, (0.5, 0.0))]")
    rows: list[Row] = []
    tables: list[NDArray[np.float64]] = []
    for load in loads:
        if not isinstance(load, Load):
            raise InvalidInput("load", load, in_words(*LOADS))
        more = rows_of(load)
        if isinstance(more, list):
            rows += more
        else:
            tables += [_filled(rows, places), more]
            rows = []
    last = _filled(rows, places)
    return np.concatenate([*tables, last]) if tables else last


def _filled(rows: Sequence[Row], places: Mapping[str, int]) -> NDArray[np.float64]:
    """The table of rows given by their columns that are not zero."""
    table = np.zeros((len(rows), len(places)))
    for index, row in enumerate(rows):
        for column, value in row.items():
            if value:  # most are zero, and a check takes less time than a write
                table[index, places[column]] = value
    return table
