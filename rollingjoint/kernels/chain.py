"""A chain at one configuration: energy, stiffness and its generators, written once for every class of chains.

A class brings its geometry, its loads and the terms of a single joint (formulas.py), and `register`s the rest.
Symbols as in docs/theory.md: r = dV/dphi (residual), H = dr/dphi (stiffness).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint.kernels import formulas
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.long_chain import (
    no_friction_outside,
    no_walls,
    same_above,
    symmetric_direction,
    unchanged,
    unlimited,
    whole_step,
)
from rollingjoint.kernels.newton import reclassified
from rollingjoint.kernels.tendons import evaluate_tendons


@part
def evaluate(chain, law, loads, state):
    """Fill the state at its angles; returns (potential energy, magnitude of its terms, force scale).

    Loads without a potential (follower loads, moments in space, end couples) are left out of the energy.
    """
    chain, law, loads, state = borrow(chain), borrow(law), borrow(loads), borrow(state)
    formulas.evaluate_geometry(chain, state)
    energy, magnitude = evaluate_tendons(law, state)
    load_energy, load_magnitude = formulas.evaluate_loads(chain, loads, state)
    scale = formulas.evaluate_residual(chain, state)
    return energy + load_energy, magnitude + load_magnitude, scale


@part
def stiffness(chain, loads, state, H):
    """Fill H, (J, J); symmetric where all loads have a potential."""
    chain, loads, state, H = borrow(chain), borrow(loads), borrow(state), borrow(H)
    gap, elastic, tension, tendon_joints = state.gap, state.elastic, state.tension, chain.tendon_joints
    for i in range(state.angle.size):
        formulas.fill_load_stiffness(chain, state, i, H)
    for j in range(elastic.size):
        for i in range(tendon_joints[j]):
            pull = elastic[j] * formulas.torque(state, i, j)
            for m in range(tendon_joints[j]):
                H[i, m] += pull * gap[m, j, 1]
    for i in range(state.angle.size):
        H[i, i] += formulas.own_stiffness(chain, state, i)
        for j in range(elastic.size):
            if i < tendon_joints[j]:
                H[i, i] += tension[j] * gap[i, j, 2]
    formulas.add_between_links(chain, loads, H)


@part
def fill_generators(chain, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep (long_chain.py): columns of the loads, then one per tendon.

    prox is added to the diagonal.
    """
    chain, loads, state = borrow(chain), borrow(loads), borrow(state)
    gap, elastic, tendon_joints = state.gap, state.elastic, chain.tendon_joints
    first = sweep.U.shape[1] - elastic.size
    formulas.fill_load_generators(chain, loads, state, prox, sweep)
    for i in range(state.angle.size):
        diagonal = sweep.diagonal[i]
        for j in range(elastic.size):
            rate = gap[i, j, 1] if i < tendon_joints[j] else 0.0
            sweep.U[i, first + j], sweep.V[i, first + j] = elastic[j] * rate, rate
            if i < tendon_joints[j]:
                diagonal += elastic[j] * rate * rate + state.tension[j] * gap[i, j, 2]
        sweep.diagonal[i] = diagonal


def register(kind: type, own: Sequence[Any] = ()) -> None:
    """Have a class of chains, the NamedTuple class of its arrays, evaluated by the functions of this module.

    own: the formulas that the class brings itself.
    """
    for generic, function in (
        (formulas.evaluate, evaluate.py_func),
        (formulas.stiffness, stiffness.py_func),
        (formulas.fill_generators, fill_generators.py_func),
        (formulas.fill_upper_generators, same_above),
        (formulas.direction, symmetric_direction),
        (formulas.shorten, whole_step),
        (formulas.renew, unchanged),
        (formulas.overshoots, unlimited),
        (formulas.soften, no_friction_outside),
        (formulas.is_among_walls, no_walls),
        (formulas.rubs_at_walls, no_walls),
        (formulas.reconsider, reclassified),
    ):
        if generic not in own:
            formula(generic, kind)(function)
