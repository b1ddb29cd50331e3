"""External loads, and the tables of rows that the kernels read.

One row acts on one body point x of one link and is the sum of everything a row can hold: world force + body force
turned with the link + spring k (anchor - x), and a moment. Planar chains take pairs (x, y) and a moment; spatial ones
triples (x, y, z) throughout. Mechanism files use the names of the fields.

Modules:
    columns: columns of load tables, and checks of tables that are given whole.
    kinds: the kinds of loads, and how `rj` takes them.
    rows: checked numbers of loads, and the rows that are made of them.
    springs: the springs that belong to a planar mechanism.
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
)
from rollingjoint.load.rows import link_index
from rollingjoint.load.springs import checked_springs
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
