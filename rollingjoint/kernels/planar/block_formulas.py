"""What the driver of eight lanes (side_by_side.solve_rows) calls, chosen by the block's class: Block or RubbedBlock.

`friction` is None for a Block, FrictionArrays for a RubbedBlock.
"""

from __future__ import annotations

from typing import Any


def fill_row(block: Any, batch: Any, friction: Any, lane: Any, row: Any, design: Any) -> Any:
    """Copy the inputs of a row into a lane, and a design unless it is -1; False where the row must be left PENDING."""
    raise TypeError("fill_row is compiled into kernels")


def advance(block: Any, chain: Any, designs: Any) -> Any:
    """One evaluation of all lanes and what follows from it; returns whether some lane has arrived or left."""
    raise TypeError("advance is compiled into kernels")


def fill_outputs(block: Any, batch: Any) -> None:
    """Fill what is stored of lanes that have arrived."""
    raise TypeError("fill_outputs is compiled into kernels")


def store_row(block: Any, batch: Any, friction: Any, lane: Any, row: Any) -> None:
    """Copy a lane that has arrived into its row of the results."""
    raise TypeError("store_row is compiled into kernels")
