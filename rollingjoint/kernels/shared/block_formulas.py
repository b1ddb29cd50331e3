"""What the driver of lanes (lanes.py) calls, chosen by the class of its block.

`friction` is None for a block without friction, else FrictionArrays.
"""

from __future__ import annotations

from typing import Any


def fill_row(block: Any, batch: Any, friction: Any, lane: Any, row: Any, design: Any) -> Any:
    """Copy the inputs of a row into a lane, and a design unless it is -1; False where the row must be left PENDING."""
    raise TypeError("fill_row is compiled into kernels")


def search_of(block: Any) -> Any:
    """Where the line searches of its lanes are (lanes.py)."""
    raise TypeError("search_of is compiled into kernels")


def evaluate_lanes(block: Any, chain: Any, designs: Any) -> Any:
    """Fill the state at its angles; returns (energy, magnitude of its terms, force scale)."""
    raise TypeError("evaluate_lanes is compiled into kernels")


def fill_row_of_loads(block: Any, i: Any, H: Any) -> Any:
    """Fill row i of H up to the diagonal with what loads add; returns what they add to the diagonal."""
    raise TypeError("fill_row_of_loads is compiled into kernels")


def own_terms(block: Any, i: Any) -> Any:
    """What joint i alone adds to the diagonal of H, its spring or its moving contact: two numbers, less the second."""
    raise TypeError("own_terms is compiled into kernels")


def evaluate_turns(rubbed: Any, tendon_joints: Any) -> None:
    """Fill how far tendons turn at the holes of a block with friction, and the rates."""
    raise TypeError("evaluate_turns is compiled into kernels")


def advance(block: Any, chain: Any, designs: Any) -> Any:
    """One evaluation of all lanes and what follows from it; returns whether some lane has arrived or left."""
    raise TypeError("advance is compiled into kernels")


def fill_outputs(block: Any, batch: Any) -> None:
    """Fill what is stored of lanes that have arrived."""
    raise TypeError("fill_outputs is compiled into kernels")


def store_row(block: Any, batch: Any, friction: Any, lane: Any, row: Any) -> None:
    """Copy a lane that has arrived into its row of the results."""
    raise TypeError("store_row is compiled into kernels")
