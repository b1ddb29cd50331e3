"""Columns of load tables, and checks of complete tables.

LOAD_COLUMNS: link, body point [mm], world force, body force [N], moment [N·mm], spring [N/mm], anchor [mm], torsion
spring [N·mm/rad], its angle at rest [rad] and its other link.
SPATIAL_LOAD_COLUMNS: link, body point [mm], world force, world moment, body force, body moment [N, N·mm], spring
[N/mm], anchor [mm], torsion spring, its angle at rest and its other link.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.hinges import SPATIAL_LOAD_COLUMNS
from rollingjoint.kernels.planar_loads import ACTING, LINK_COLUMNS, LOAD_COLUMNS

__all__ = [
    "LOAD_COLUMNS",
    "SPATIAL_LOAD_COLUMNS",
    "acts",
    "check_table",
    "pair_columns",
    "with_all_columns",
    "wrong_links",
]

_OPTIONAL_COLUMNS = 3  # a table may leave out its last columns, of torsion springs, which are zero then


def pair_columns(*letters: str) -> list[slice]:
    """The columns of planar load tables that hold the pairs x, y of these letters, such as "p" for px, py."""
    firsts = [LOAD_COLUMNS.index(f"{letter}x") for letter in letters]
    return [slice(first, first + 2) for first in firsts]


def acts(table: NDArray[np.float64]) -> bool:
    """Whether any row of a planar load table has an effect."""
    return bool(np.any(table[..., list(ACTING)]))


def with_all_columns(tables: Any, columns: Sequence[str], pad: Callable[[Any, int], Any]) -> Any:
    """Load tables (..., rows, columns) with the trailing columns that they may omit; None for a wrong width.

    `pad` appends a number of columns of zeros.
    """
    missing = len(columns) - tables.shape[-1]
    if missing == 0:
        return tables
    return pad(tables, missing) if 0 < missing <= _OPTIONAL_COLUMNS else None


def wrong_links(tables: Any, columns: Sequence[str], n_links: int) -> Any:
    """The first column of load tables (..., rows, columns) with a link that does not exist, or None."""
    for name in LINK_COLUMNS:
        if name in columns:
            links = tables[..., columns.index(name)]
            if not bool(((links >= 0) & (links < n_links) & (links % 1 == 0)).all()):
                return links
    return None


def check_table(tables: Any, columns: Sequence[str], n_links: int) -> None:
    """Raise InvalidInput unless load tables (..., rows, columns) have these columns, and links that exist."""
    if not isinstance(tables, np.ndarray) or tables.dtype != float or tables.shape[-1] != len(columns):
        raise InvalidInput("loads", tables, f"a table of floats with {len(columns)} columns")
    links = wrong_links(tables, columns, n_links)
    if links is not None:
        raise InvalidInput("links of the load table", links, f"integers from 0 to {n_links - 1}")
