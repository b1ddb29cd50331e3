"""External loads, and the tables of rows that the kernels read.

One row acts on one body point x of one link and is the sum of its columns: world force + body force
turned with the link + spring k (anchor - x), and a moment. Planar chains take pairs (x, y) and a moment; spatial ones
triples (x, y, z) throughout. Mechanism files use the names of the fields.

Modules:
    columns: columns of load tables, and checks of complete tables.
    kinds: the kinds of loads, their rows of load tables, the springs of mechanisms, and the options of `rj`.
    table: the rows of all loads on a mechanism.
"""

from rollingjoint.load.columns import (
    LOAD_COLUMNS,
    SPATIAL_LOAD_COLUMNS,
    acts,
    check_table,
    pair_columns,
    with_all_columns,
    wrong_links,
)
from rollingjoint.load.kinds import (
    LOADS,
    OPTIONS,
    SPRINGS,
    BodyWrench,
    Gravity,
    Load,
    Option,
    Spring,
    TorsionSpring,
    WorldForce,
    checked_springs,
    link_index,
)
from rollingjoint.load.table import load_table, spatial_load_table

__all__ = [
    "LOADS",
    "LOAD_COLUMNS",
    "OPTIONS",
    "SPATIAL_LOAD_COLUMNS",
    "SPRINGS",
    "BodyWrench",
    "Gravity",
    "Load",
    "Option",
    "Spring",
    "TorsionSpring",
    "WorldForce",
    "acts",
    "check_table",
    "checked_springs",
    "link_index",
    "load_table",
    "pair_columns",
    "spatial_load_table",
    "with_all_columns",
    "wrong_links",
]
