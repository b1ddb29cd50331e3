"""The formulas that every family of mechanisms has, chosen by the type of the chain when a kernel is compiled.

Newton's method and the rest of this folder call these names; each family registers its own parts for them. numba cannot
take functions as arguments without losing its disk cache.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.extending import overload

from rollingjoint._numba.jit import PART_OPTIONS, part


def design(chain: Any, which: Any) -> Any:
    """One mechanism of a stack."""
    raise TypeError("design is compiled into kernels")


def evaluate(chain: Any, law: Any, loads: Any, state: Any) -> Any:
    """Fill the state at its angles; returns (potential energy, magnitude of its terms, force scale)."""
    raise TypeError("evaluate is compiled into kernels")


def stiffness(chain: Any, loads: Any, state: Any, H: Any) -> None:
    """Fill H = dr/dangle, (J, J), at an evaluated state."""
    raise TypeError("stiffness is compiled into kernels")


def fill_generators(chain: Any, loads: Any, state: Any, prox: Any, sweep: Any) -> None:
    """Fill diagonal, U and V of a Sweep at an evaluated state: H_im = U_i . V_m for i > m; prox joins the diagonal."""
    raise TypeError("fill_generators is compiled into kernels")


def fill_turns(chain: Any, state: Any, turn: Any) -> None:
    """Fill how far the tendons turn at the holes of every link, and the rates (friction.Rubbing.turn)."""
    raise TypeError("fill_turns is compiled into kernels")


def fill_normals(chain: Any, state: Any, rolling: Any) -> None:
    """Fill what presses the links of every joint together: per tension of its gaps, and the share of the loads."""
    raise TypeError("fill_normals is compiled into kernels")


def first_tendon_column(chain: Any, columns: Any) -> Any:
    """Where the columns of the tendons begin among those that fill_generators fills."""
    raise TypeError("first_tendon_column is compiled into kernels")


def direction(chain: Any, H: Any, sweep: Any, free: Any, residual: Any, L: Any, step: Any) -> None:
    """Fill a step along which the line search descends: Newton's, changed where H is not positive definite."""
    raise TypeError("direction is compiled into kernels")


def renew(chain: Any, state: Any, energy: Any, magnitude: Any) -> Any:
    """(energy, magnitude) with everything that a line search holds constant taken at the present state."""
    raise TypeError("renew is compiled into kernels")


def overshoots(chain: Any, slope: Any, new_slope: Any) -> Any:
    """Whether a step ends too far beyond the minimum along it; slopes of the merit at its start and its end."""
    raise TypeError("overshoots is compiled into kernels")


def reconsider(chain: Any, loads: Any, state: Any, free: Any, kind: Any) -> Any:
    """The kind of a stationary point where H is not positive definite; kind: what H says."""
    raise TypeError("reconsider is compiled into kernels")


def formula(generic: Callable[..., Any], kind: type) -> Callable[[Callable[..., Any]], Any]:
    """Make a function the part that stands for a generic formula where the chain is of this NamedTuple class."""

    def register(function: Callable[..., Any]) -> Any:
        @overload(generic, jit_options=PART_OPTIONS, strict=False)
        def choose(chain: Any, *others: Any) -> Callable[..., Any] | None:
            return function if getattr(chain, "instance_class", None) is kind else None

        return part(function)

    return register
