"""Capstan friction with memory of the tendons in their holes: tensions of every gap, slip, and their derivatives.

Link k of a tendon has one friction state z, -1 to 1, which its slip s drives: z = clip(z⁻ - (s - s⁻)/δ). The tension of
gap i is T0 exp(-μ Σ z θ) - f Σ z over the links k <= i; θ is the turn of the tendon at both holes of a link. Everything
here but the rolling resistance serves floats and SIMD lanes alike. Source: docs/theory.md, section 9.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats
from rollingjoint._numba.simd import any_lane, where
from rollingjoint.kernels.arrays import LARGEST_INPUT, empty_arrays, resolvable
from rollingjoint.kernels.elementary import decay

# Columns of FrictionLaw.tendons: μ, δ [mm], turn [rad] and force [N] that every link adds, stretch per newton between
# the base and the end of the tendon [mm/N]
MU, PRESLIDING, EXTRA_TURN, CONSTANT, COMPLIANCE, N_COEFFICIENTS = range(6)
ARM, ROLLING_PRESLIDING = range(2)  # of FrictionLaw.rolling [mm, rad]
# Columns of Rubbing.turn: turn of a tendon at both holes of link k, the angles at each added up; how the turn at the
# hole below gap k, and at the one above it, changes with the angle of joint k
TURN, BELOW_RATE, ABOVE_RATE, N_TURN = range(4)


MOST_OVERSHOOT = 0.5  # of the slope at the start of a line search, at the end of its step
_STILL = 1e-8  # a friction state below it is zero


class FrictionLaw(NamedTuple):
    """Coefficients of friction of every tendon, and of the rolling contacts."""

    tendons: Annotated[Floats, "m", N_COEFFICIENTS]
    rolling: Annotated[Floats, 2]


class History(NamedTuple):
    """State of friction between one step and the next."""

    states: Annotated[Floats, "J", "m"]  # z of link k at [k]
    slips: Annotated[Floats, "J", "m"]  # s: length from link k to the end of the tendon less its stretch [mm]
    grips: Annotated[Floats, "J", "m"]  # force that the holes of a link hold at z = 1 [N]
    angles: Annotated[Floats, "J"]
    rolling: Annotated[Floats, "J"]  # state of the rolling resistance, -1 to 1


class FrictionArrays(NamedTuple):
    """Friction of B lanes: coefficients, histories, and outputs."""

    law: Annotated[FrictionLaw, "B"]
    before: Annotated[History, "B"]
    after: Annotated[History, "B"]
    tension: Annotated[Floats, "B", "J", "m"]  # of every gap
    work: Annotated[Floats, "B"]  # dissipated in the step [N·mm]


class Rubbing(NamedTuple):
    """Friction evaluated at one configuration."""

    turn: Annotated[Floats, "J", "m", N_TURN]  # columns above
    states: Annotated[Floats, "J", "m"]
    slips: Annotated[Floats, "J", "m"]
    grips: Annotated[Floats, "J", "m"]
    tension: Annotated[Floats, "J", "m"]
    lever: Annotated[Floats, "J", "m"]  # d residual / d tension
    passed: Annotated[Floats, "J", "m"]  # d tension / d tension at the motor
    carried: Annotated[Floats, "J", "m"]  # T0 exp(-μ Σ z θ)
    give: Annotated[Floats, "J", "m"]  # d (μ Σ z θ) / d slip of the links up to this one that stick
    flat: Annotated[Floats, "J", "m"]  # d (f Σ z) / d slip, likewise
    bend: Annotated[Floats, "J", "m", 2]  # d (μ Σ z θ) / d angle at constant z: of this gap, and of the next ones
    frozen: Annotated[Floats, "J", "m"]  # grips where the line search began
    frozen_tension: Annotated[Floats, "m"]  # T0 there


def new_friction_arrays(law: FrictionLaw, before: History) -> FrictionArrays:
    """Friction of B lanes with empty outputs."""
    holes, joints = before.states.shape, before.angles.shape
    *after, tension, work = empty_arrays([holes, holes, holes, joints, joints, holes, joints[:1]], joints[0])
    return FrictionArrays(law, before, History(*after), tension, work)


def histories_of(friction: FrictionArrays, first: int, last: int) -> tuple[FrictionLaw, History]:
    """Coefficients and histories of lanes first to last - 1."""
    law, before = ([array[first:last] for array in arrays] for arrays in (friction.law, friction.before))
    return FrictionLaw(*law), History(*before)


@part(inline=True)
def slide(before, way, presliding):
    """The friction state after a slip of `way` [mm]."""
    z = before - way / presliding
    return where(z > 1.0, 1.0, where(z < -1.0, -1.0, z))


@part(inline=True)
def work_per_grip(before, after, way, presliding):
    """-∫ z ds over the way from one friction state to the next: work per newton of grip [mm]."""
    change = before - after
    stuck = change * presliding
    return (0.5 * change - before) * stuck - after * (way - stuck)


@part(inline=True)
def stretch_per_tension(coefficients, count, k, j):
    """Stretch of tendon j beyond link k per newton [mm/N]; count: joints that the tendon crosses."""
    return coefficients[j, COMPLIANCE] * ((count - k) / count)


@part(inline=True)
def evaluate_slips(coefficients, tendon_joints, state, now):
    """Fill the slip coordinates from gaps and tensions at the motor."""
    for j in range(tendon_joints.size):
        count = tendon_joints[j]
        slip = 0.0 * state.angle[0]
        for k in range(count - 1, -1, -1):
            slip = slip + state.gap[k, j, 0]
            now.slips[k, j] = slip
        if any_lane(coefficients[j, COMPLIANCE] > 0.0):
            for k in range(count):
                now.slips[k, j] -= stretch_per_tension(coefficients, count, k, j) * state.tension[j]


@part(inline=True)
def evaluate_holes(coefficients, before, tendon_joints, state, now):
    """Fill friction states, tensions of the gaps and their rates, from slips and turns."""
    zero = 0.0 * state.angle[0]
    for j in range(tendon_joints.size):
        mu, motor = coefficients[j, MU], state.tension[j]
        per_presliding = 1.0 / coefficients[j, PRESLIDING]
        share, give, carried = zero + 1.0, zero, motor
        for k in range(tendon_joints[j]):
            free = before.states[k, j] - (now.slips[k, j] - before.slips[k, j]) * per_presliding
            z = where(free > 1.0, 1.0, where(free < -1.0, -1.0, free))
            resistance = mu * (now.turn[k, j, TURN] + coefficients[j, EXTRA_TURN])
            passing, mean = decay(resistance * z)
            now.grips[k, j] = carried * resistance * mean
            share = share * passing
            carried = motor * share
            give = give + resistance * where(abs(z) < 1.0, per_presliding, 0.0)
            now.states[k, j], now.tension[k, j], now.carried[k, j] = z, carried, carried
            now.passed[k, j], now.give[k, j], now.flat[k, j] = share, give, zero
            now.lever[k, j] = state.gap[k, j, 1]
            if k > 0:
                now.bend[k - 1, j, 1] = now.bend[k - 1, j, 0] + mu * z * now.turn[k - 1, j, ABOVE_RATE]
            now.bend[k, j, 0] = mu * z * now.turn[k, j, BELOW_RATE]
        if any_lane((coefficients[j, CONSTANT] > 0.0) | (coefficients[j, COMPLIANCE] > 0.0)):
            _add_options(coefficients, tendon_joints[j], state, now, j)


@part
def _add_options(coefficients, count, state, now, j):
    """Add constant forces and stretch in the channels to the results of `evaluate_holes` for one tendon.

    A tension smaller than the constant forces is zero.
    """
    constant = coefficients[j, CONSTANT]
    lost = flat = yielding = sinking = give = 0.0 * state.angle[0]
    below = state.tension[j]
    for k in range(count):
        z = now.states[k, j]
        per_slip = where(abs(z) < 1.0, 1.0 / coefficients[j, PRESLIDING], 0.0)
        lost, flat = lost + constant * z, flat + constant * per_slip
        stretch = stretch_per_tension(coefficients, count, k, j)
        yielding = yielding + (now.give[k, j] - give) * stretch
        sinking, give = sinking + constant * per_slip * stretch, now.give[k, j]
        pulls = now.carried[k, j] >= lost
        tension = where(pulls, now.carried[k, j] - lost, 0.0)
        remaining = below / where(abs(z) > _STILL, z, 1.0)  # the holes can take no more than the tension below
        now.grips[k, j] = where(pulls, now.grips[k, j] + constant, remaining)
        now.tension[k, j], now.flat[k, j] = tension, flat
        now.passed[k, j] = now.passed[k, j] - now.carried[k, j] * yielding - sinking
        now.lever[k, j] = where(pulls, now.lever[k, j], 0.0)
        below = tension


@part(inline=True)
def tension_rate(state, now, i, m, j):
    """d tension of gap i / d angle of joint m."""
    rate = state.gap[m, j, 1]
    value = state.elastic[j] * now.passed[i, j] * rate
    if m < i:
        return (
            value + (now.carried[i, j] * now.give[m, j] + now.flat[m, j]) * rate - now.carried[i, j] * now.bend[m, j, 1]
        )
    value = value + (now.carried[i, j] * now.give[i, j] + now.flat[i, j]) * rate
    if m == i:
        value = value - now.carried[i, j] * now.bend[i, j, 0]
    return value


@part(inline=True)
def friction_energy(coefficients, before, tendon_joints, state, now, grips, motor):
    """Incremental potential of the holes at constant grips, and stretch at constant tensions at the motor; its size."""
    zero = 0.0 * state.angle[0]
    energy, magnitude = zero, zero
    for j in range(tendon_joints.size):
        count = tendon_joints[j]
        for k in range(count):
            stretch = stretch_per_tension(coefficients, count, k, j) * (state.tension[j] - motor[j])
            way = now.slips[k, j] + stretch - before.slips[k, j]
            after = slide(before.states[k, j], way, coefficients[j, PRESLIDING])
            term = grips[k, j] * work_per_grip(before.states[k, j], after, way, coefficients[j, PRESLIDING])
            energy, magnitude = energy + term, magnitude + abs(term)
    return energy, magnitude


@part(inline=True)
def evaluated_energy(coefficients, before, tendon_joints, now):
    """Incremental potential at an evaluated state without stretch in the channels, and the work of the holes.

    Returns (potential at the frozen grips, its magnitude, potential at the present grips, work with the mean of the
    grips before and after the step) [N·mm].
    """
    zero = 0.0 * now.slips[0, 0]
    energy, magnitude, present, earlier = zero, zero, zero, zero
    for j in range(tendon_joints.size):
        for k in range(tendon_joints[j]):
            way = now.slips[k, j] - before.slips[k, j]
            per_grip = work_per_grip(before.states[k, j], now.states[k, j], way, coefficients[j, PRESLIDING])
            term = now.frozen[k, j] * per_grip
            energy, magnitude = energy + term, magnitude + abs(term)
            present, earlier = present + now.grips[k, j] * per_grip, earlier + before.grips[k, j] * per_grip
    return energy, magnitude, present, 0.5 * (present + earlier)


@part(inline=True)
def overshoots_kink(slope, new_slope):
    """Whether a step ends too far beyond the minimum along it: there the grips may send the next one right back.

    slope, new_slope: of the merit along the step, at its start (negative) and at its end.
    """
    return new_slope > -MOST_OVERSHOOT * slope


@part(inline=True)
def freeze(tendon_joints, state, now):
    """Keep the present grips and tensions at the motor for the next line search."""
    for j in range(tendon_joints.size):
        now.frozen_tension[j] = state.tension[j]
        for k in range(tendon_joints[j]):
            now.frozen[k, j] = now.grips[k, j]


@part(inline=True)
def friction_of(law, lane):
    """The coefficients of one lane."""
    return FrictionLaw(law.tendons[lane], law.rolling[lane])


@part(inline=True)
def history_of(history, lane):
    """The history of one lane."""
    return History(
        history.states[lane], history.slips[lane], history.grips[lane], history.angles[lane], history.rolling[lane]
    )


@part(inline=True)
def valid_law(law):
    """True for coefficients between 0 and LARGEST_INPUT, presliding above 0; False for NaN."""
    valid = 0.0 <= law.rolling[ARM] <= LARGEST_INPUT and 0.0 < law.rolling[ROLLING_PRESLIDING] <= LARGEST_INPUT
    for j in range(law.tendons.shape[0]):
        for column in range(N_COEFFICIENTS):
            valid = valid and 0.0 <= law.tendons[j, column] <= LARGEST_INPUT
        valid = valid and law.tendons[j, PRESLIDING] > 0.0
    return valid


@part
def valid_friction(law, history):
    """True for a `valid_law` and a history of finite numbers below LARGEST_INPUT, states from -1 to 1."""
    valid = valid_law(law)
    for k in range(history.angles.size):
        valid = valid and resolvable(history.angles[k]) and abs(history.rolling[k]) <= 1.0
        for j in range(law.tendons.shape[0]):
            valid = valid and resolvable(history.slips[k, j]) and resolvable(history.grips[k, j])
            valid = valid and abs(history.states[k, j]) <= 1.0
    return valid
