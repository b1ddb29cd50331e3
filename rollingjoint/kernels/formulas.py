"""The formulas that every class of chains has, chosen by the type of its arrays when a kernel is compiled.

Newton's method and the driver of lanes call these names; each class of chains registers its own parts for them: for
one configuration by its chain (rolling_solve.py, hinge_solve.py), for lanes by its block (rolling_lanes.py,
hinge_lanes.py). numba cannot take functions as arguments without losing
its disk cache.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.extending import overload

from rollingjoint._numba.jit import PART_OPTIONS, part


def design(chain: Any, which: Any) -> Any:
    """One mechanism of a stack."""
    raise TypeError("design is compiled into kernels")


def new_state(chain: Any, n_joints: Any, n_tendons: Any) -> Any:
    """Empty arrays for all quantities of one configuration."""
    raise TypeError("new_state is compiled into kernels")


def middle(chain: Any, i: Any) -> Any:
    """A pose of joint i that is always possible."""
    raise TypeError("middle is compiled into kernels")


def load_columns(chain: Any) -> Any:
    """Number of columns of a load table."""
    raise TypeError("load_columns is compiled into kernels")


def stiffness_columns(chain: Any) -> Any:
    """The columns of a load table in which a number must not be negative."""
    raise TypeError("stiffness_columns is compiled into kernels")


def solve(chain: Any, law: Any, loads: Any, start: Any, state: Any) -> Any:
    """Equilibrium from joint angles; fills the state; returns (status, iterations, largest free |r|, escapes)."""
    raise TypeError("solve is compiled into kernels")


def solve_step(
    chain: Any, friction: Any, before: Any, law: Any, loads: Any, start: Any, state: Any, memory: Any
) -> Any:
    """The step with friction; fills the state and the memory (rubbed_chain.py); returns as `solve`."""
    raise TypeError("solve_step is compiled into kernels")


def store(chain: Any, state: Any, outcome: Any, results: Any, lane: Any) -> None:
    """Copy a solved state and the outcome of `solve` into the results."""
    raise TypeError("store is compiled into kernels")


def store_friction(chain: Any, state: Any, memory: Any, results: Any, lane: Any) -> None:
    """Copy the outputs that depend on friction into the results."""
    raise TypeError("store_friction is compiled into kernels")


def evaluate(chain: Any, law: Any, loads: Any, state: Any) -> Any:
    """Fill the state at its angles; returns (potential energy, magnitude of its terms, force scale)."""
    raise TypeError("evaluate is compiled into kernels")


def evaluate_geometry(chain: Any, state: Any) -> None:
    """Fill poses, gaps and tendon lengths at the angles."""
    raise TypeError("evaluate_geometry is compiled into kernels")


def evaluate_loads(chain: Any, loads: Any, state: Any) -> Any:
    """Fill the sums of loads beyond each joint; returns the energy of loads and joints, and its terms' magnitude."""
    raise TypeError("evaluate_loads is compiled into kernels")


def evaluate_residual(chain: Any, state: Any) -> Any:
    """Fill r; returns the largest sum of its terms' magnitudes, every tension with a lever of at least 1 mm."""
    raise TypeError("evaluate_residual is compiled into kernels")


def pivot(state: Any, i: Any) -> Any:
    """Point about which joint i turns, in the base frame: its hinge or its contact; in the plane z is 0."""
    raise TypeError("pivot is compiled into kernels")


def axis(state: Any, i: Any) -> Any:
    """Unit axis about which joint i turns, in the base frame; in the plane its normal, (0, 0, 1)."""
    raise TypeError("axis is compiled into kernels")


def origin(state: Any, k: Any) -> Any:
    """Origin of link k in the base frame; in the plane z is 0."""
    raise TypeError("origin is compiled into kernels")


def frame(state: Any, k: Any) -> Any:
    """Rotation matrix of link k, nine numbers row by row."""
    raise TypeError("frame is compiled into kernels")


def has_end_couples(chain: Any) -> Any:
    """Whether tendons act as couples on their last links, without a potential; chains in space."""
    raise TypeError("has_end_couples is compiled into kernels")


def add_end_couples(chain: Any, state: Any) -> None:
    """Fill torques and sums of tendons that act as a couple on their last link alone; chains in space."""
    raise TypeError("add_end_couples is compiled into kernels")


def torque(state: Any, i: Any, j: Any) -> Any:
    """Moment of a tendon about joint i per tension [mm]."""
    raise TypeError("torque is compiled into kernels")


def own_stiffness(chain: Any, state: Any, i: Any) -> Any:
    """Term of joint i alone on the diagonal of H: its spring, its moving contact [N·mm/rad]."""
    raise TypeError("own_stiffness is compiled into kernels")


def fill_load_stiffness(chain: Any, state: Any, i: Any, H: Any) -> None:
    """Fill H_im and H_mi, m <= i, with the terms of loads on one link beyond joint i."""
    raise TypeError("fill_load_stiffness is compiled into kernels")


def add_between_links(chain: Any, loads: Any, H: Any) -> None:
    """Add to H the terms of loads between two links."""
    raise TypeError("add_between_links is compiled into kernels")


def fill_load_generators(chain: Any, loads: Any, state: Any, prox: Any, sweep: Any) -> None:
    """Fill the diagonal (prox on it) and first columns of U and V of a Sweep with the terms of loads and joints."""
    raise TypeError("fill_load_generators is compiled into kernels")


def generator_columns(chain: Any, loads: Any) -> Any:
    """Number of columns of a Sweep for the loads."""
    raise TypeError("generator_columns is compiled into kernels")


def stiffness(chain: Any, loads: Any, state: Any, H: Any) -> None:
    """Fill H = dr/dangle, (J, J), at an evaluated state."""
    raise TypeError("stiffness is compiled into kernels")


def fill_generators(chain: Any, loads: Any, state: Any, prox: Any, sweep: Any) -> None:
    """Fill diagonal, U and V of a Sweep at an evaluated state: H_im = U_i . V_m for i > m; prox joins the diagonal."""
    raise TypeError("fill_generators is compiled into kernels")


def fill_turns(chain: Any, state: Any, turn: Any) -> None:
    """Fill the turns of the tendons at the holes of every link, and their rates (friction.Rubbing.turn)."""
    raise TypeError("fill_turns is compiled into kernels")


def fill_normals(chain: Any, state: Any, rolling: Any) -> None:
    """Fill the normal force between the links of every joint: per tension of its gaps, and the share of the loads."""
    raise TypeError("fill_normals is compiled into kernels")


def fill_upper_generators(chain: Any, state: Any, U: Any, Q: Any) -> None:
    """Fill Q, the generators above the diagonal, from those below it, U of a Sweep: others where H is not symmetric."""
    raise TypeError("fill_upper_generators is compiled into kernels")


def direction(chain: Any, H: Any, sweep: Any, free: Any, residual: Any, L: Any, step: Any) -> None:
    """Fill a step along which the line search descends: Newton's, changed where H is not positive definite."""
    raise TypeError("direction is compiled into kernels")


def shorten(chain: Any, state: Any, step: Any, is_newtons: Any) -> Any:
    """Shorten a step that would move the chain too far; returns the factor, 1 where the step stays as it is."""
    raise TypeError("shorten is compiled into kernels")


def soften(chain: Any, softness: Any) -> None:
    """Multiply the presliding of friction outside the chain."""
    raise TypeError("soften is compiled into kernels")


def is_among_walls(chain: Any) -> Any:
    """Whether there are walls around the chain."""
    raise TypeError("is_among_walls is compiled into kernels")


def rubs_at_walls(chain: Any) -> Any:
    """Whether walls rub by a law without a potential, as along two directions; chains in space."""
    raise TypeError("rubs_at_walls is compiled into kernels")


def contact_sizes(walls: Any, n_joints: Any) -> Any:
    """Lengths of the axes of the memory of a solve among a stack of walls."""
    raise TypeError("contact_sizes is compiled into kernels")


def new_contacts(sizes: Any) -> Any:
    """Empty memory of a solve among walls, of these `contact_sizes`."""
    raise TypeError("new_contacts is compiled into kernels")


def contacts_in(sizes: Any, space: Any) -> Any:
    """The arrays in the memory of a solve among walls."""
    raise TypeError("contacts_in is compiled into kernels")


def see(walls: Any, which: Any, base: Any, seen: Any) -> None:
    """Fill the walls as seen from the pose of a base."""
    raise TypeError("see is compiled into kernels")


def walled(place: Any, chain: Any, before: Any) -> Any:
    """The chain among the walls of a memory; before: what contacts remember."""
    raise TypeError("walled is compiled into kernels")


def touched_of(touched: Any, lane: Any) -> Any:
    """What the contacts of one lane remember."""
    raise TypeError("touched_of is compiled into kernels")


def valid_memory(touched: Any) -> Any:
    """Whether what contacts remember are finite numbers."""
    raise TypeError("valid_memory is compiled into kernels")


def forget_ways(touch: Any) -> None:
    """Forget how far points of a chain are from walls."""
    raise TypeError("forget_ways is compiled into kernels")


def begin_rubbing(touch: Any, rubs: Any) -> None:
    """Forget friction at walls in the last solve; rubs: 1 with friction in this one, else 0."""
    raise TypeError("begin_rubbing is compiled into kernels")


def touch_walls(chain: Any, state: Any, all_gaps: Any) -> Any:
    """Fill the contact of every candidate, and the sums of each link; returns (energy, magnitude of its terms)."""
    raise TypeError("touch_walls is compiled into kernels")


def passes(place: Any, state: Any, walls: Any, lane: Any) -> Any:
    """Whether a chain has passed through a wall on its way from the equilibrium before."""
    raise TypeError("passes is compiled into kernels")


def store_contacts(touch: Any, walls: Any, lane: Any) -> None:
    """Copy friction states into the outputs of one lane."""
    raise TypeError("store_contacts is compiled into kernels")


def link_forces(touch: Any, state: Any, forces: Any) -> None:
    """Fill the wall force on every link and its moment about its origin, in the base frame [N, N·mm]."""
    raise TypeError("link_forces is compiled into kernels")


def remember_contact(chain: Any, state: Any, status: Any, after: Any) -> None:
    """Fill what contacts remember after a step, but for normal forces."""
    raise TypeError("remember_contact is compiled into kernels")


def base_stiffness(chain: Any, state: Any, S: Any) -> None:
    """Fill d residual / d velocity of the base in its own frame."""
    raise TypeError("base_stiffness is compiled into kernels")


def force_rates(chain: Any, state: Any, rates: Any) -> None:
    """Fill d force of all walls / d joint angle and d velocity of the base in its own frame."""
    raise TypeError("force_rates is compiled into kernels")


def renew(chain: Any, state: Any, energy: Any, magnitude: Any) -> Any:
    """(energy, magnitude) with the constants of a line search taken at the present state."""
    raise TypeError("renew is compiled into kernels")


def overshoots(chain: Any, slope: Any, new_slope: Any) -> Any:
    """Whether a step ends too far beyond the minimum along it; slopes of the merit at its start and its end."""
    raise TypeError("overshoots is compiled into kernels")


def reconsider(chain: Any, loads: Any, state: Any, free: Any, kind: Any) -> Any:
    """The kind of a stationary point where H is not positive definite; kind: the kind by H alone."""
    raise TypeError("reconsider is compiled into kernels")


def formula(generic: Callable[..., Any], *kinds: type) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: the function is the part for a generic formula where the chain is of one of these NamedTuples."""

    def register(function: Callable[..., Any]) -> Any:
        @overload(generic, jit_options=PART_OPTIONS, strict=False)
        def choose(chain: Any, *others: Any) -> Callable[..., Any] | None:
            return function if getattr(chain, "instance_class", None) in kinds else None

        return part(function)

    return register


def fill_row(block: Any, batch: Any, friction: Any, lane: Any, row: Any, design: Any) -> Any:
    """Copy the inputs of a row into a lane, and a design unless it is -1; False where the row must be left PENDING."""
    raise TypeError("fill_row is compiled into kernels")


def search_of(block: Any) -> Any:
    """The array of the line searches of its lanes (lanes.py)."""
    raise TypeError("search_of is compiled into kernels")


def evaluate_lanes(block: Any, chain: Any, designs: Any) -> Any:
    """Fill the state at its angles; returns (energy, magnitude of its terms, force scale)."""
    raise TypeError("evaluate_lanes is compiled into kernels")


def fill_row_of_loads(block: Any, i: Any, H: Any) -> Any:
    """Fill row i of H up to the diagonal with the terms of loads; returns their term on the diagonal."""
    raise TypeError("fill_row_of_loads is compiled into kernels")


def own_terms(block: Any, i: Any) -> Any:
    """Term of joint i alone on the diagonal of H, its spring or moving contact: two numbers, less the second."""
    raise TypeError("own_terms is compiled into kernels")


def evaluate_turns(rubbed: Any, tendon_joints: Any) -> None:
    """Fill the turns of tendons at the holes of a block with friction, and their rates."""
    raise TypeError("evaluate_turns is compiled into kernels")


def advance(block: Any, chain: Any, designs: Any) -> Any:
    """One evaluation of all lanes and the next step of each; returns whether a lane has arrived or left."""
    raise TypeError("advance is compiled into kernels")


def fill_outputs(block: Any, batch: Any) -> None:
    """Fill the stored outputs of lanes that have arrived."""
    raise TypeError("fill_outputs is compiled into kernels")


def store_row(block: Any, batch: Any, friction: Any, lane: Any, row: Any) -> None:
    """Copy a lane that has arrived into its row of the results."""
    raise TypeError("store_row is compiled into kernels")
