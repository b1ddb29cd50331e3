"""What the hidden numbers change at an equilibrium of the nominal surfaces, compiled; symbols as in kernels.py."""

from __future__ import annotations

import math

from rollingjoint.compiled import (
    part,
)
from rollingjoint.estimate.hidden import PER_JOINT
from rollingjoint.load import LOAD_COLUMNS

FX = LOAD_COLUMNS.index("fx")


@part(inline=True)
def load_acts(model, step):
    """1 where the load acts in a step, else 0."""
    return 0.0 if step == 0 and model.law.shown_sd < math.inf else 1.0


@part(inline=True)
def fill_causes(model, chain, track, batch, scratch, row):
    """Fill the torques at joints by a change of the force, the commands and the surfaces; joints at a limit stay."""
    state, causes, results = scratch.state, scratch.causes, batch.results
    n_joints, m = state.angle.size, state.length.size
    link = track.links[row]
    x, y, acts = state.pose[link, 0], state.pose[link, 1], load_acts(model, track.steps[row])
    for i in range(n_joints):
        carries = acts if i < link else 0.0
        causes[i, 0] = carries * (state.contact[i, 1] - y)
        causes[i, 1] = carries * (x - state.contact[i, 0])
        for j in range(m):
            rate = state.gap[i, j, 1] if i < chain.tendon_joints[j] else 0.0
            causes[i, 2 + j] = results.elastic[row, j] * rate
        for c in range(2 + m, causes.shape[1]):
            causes[i, c] = 0.0
    if causes.shape[1] > 2 + m:
        evaluate_tables(model.tables, state.angle, scratch)
        add_surfaces(chain, track, batch, scratch, row)
    for i in range(n_joints):
        if not chain.joints[i, 0] < state.angle[i] < chain.joints[i, 1]:
            for c in range(causes.shape[1]):
                causes[i, c] = 0.0
            for k in range(n_joints):
                scratch.H[i, k] = scratch.H[k, i] = 0.0
            scratch.H[i, i] = 1.0


@part(inline=True)
def evaluate_tables(tables, angle, scratch):
    """Fill the rates by the surfaces and their derivatives, of every joint."""
    n_points, n_rates = tables.values.shape[1], tables.values.shape[2]
    for i in range(angle.size):
        place = min(max((angle[i] - tables.lowest[i]) * tables.per_radian[i], 0.0), n_points - 1.0)
        point = min(int(place), n_points - 2)
        share = place - point
        for k in range(n_rates):
            value, slope = tables.values[i, point, k], tables.slopes[i, point, k]
            scratch.values[i, k] = value + share * (tables.values[i, point + 1, k] - value)
            scratch.slopes[i, k] = slope + share * (tables.slopes[i, point + 1, k] - slope)


@part(inline=True)
def add_surfaces(chain, track, batch, scratch, row):
    """Add the torques by the surfaces: -dr/ds = -T dg'/ds - k g' dl/ds + F d(dx/dphi)/ds."""
    state, causes, results = scratch.state, scratch.causes, batch.results
    n_joints, m, link = state.angle.size, state.length.size, track.links[row]
    fx, fy = batch.loads[row, 0, FX], batch.loads[row, 0, FX + 1]
    for below in range(n_joints):
        cos, sin = state.pose[below, 3], state.pose[below, 4]
        for number in range(PER_JOINT):
            c, first = 2 + m + PER_JOINT * below + number, number * (m + 2)
            for j in range(m):
                pull = results.elastic[row, j] * scratch.values[below, first + j]
                for i in range(chain.tendon_joints[j]):
                    causes[i, c] -= pull * state.gap[i, j, 1]
                if below < chain.tendon_joints[j]:
                    causes[below, c] -= results.tensions[row, j] * scratch.slopes[below, first + j]
            if below < link:
                dx, dy = scratch.values[below, first + m], scratch.values[below, first + m + 1]
                x, y = cos * dx - sin * dy, sin * dx + cos * dy
                for i in range(below):
                    causes[i, c] += fy * x - fx * y
                dx, dy = scratch.slopes[below, first + m], scratch.slopes[below, first + m + 1]
                causes[below, c] += fx * (cos * dx - sin * dy) + fy * (sin * dx + cos * dy)


@part(inline=True)
def fill_rates(model, track, batch, scratch, row):
    """Fill tip and tensions with their derivatives by all hidden numbers; displaced surfaces change both linearly."""
    state, turns, at, results = scratch.state, scratch.causes, model.at, batch.results
    n_joints, m = state.angle.size, state.length.size
    n_causes, tip_by, tensions_by = turns.shape[1], track.tip_by[row], track.tensions_by[row]
    for k in range(at.total):
        tip_by[0, k] = tip_by[1, k] = 0.0
        for j in range(m):
            tensions_by[j, k] = 0.0
    track.tip[row, 0], track.tip[row, 1] = state.pose[n_joints, 0], state.pose[n_joints, 1]
    for j in range(m):
        rates, elastic = scratch.rates[j], results.elastic[row, j]
        track.tensions[row, j] = results.tensions[row, j]
        for c in range(n_causes):
            rates[c] = 0.0
        for c in range(2 + m, n_causes):
            below, number = divmod(c - 2 - m, PER_JOINT)
            rates[c] = scratch.values[below, number * (m + 2) + j]
        for i in range(n_joints):
            rate = state.gap[i, j, 1] if i < model.chain.tendon_joints[j] else 0.0
            for c in range(n_causes):
                rates[c] += rate * turns[i, c]
        rates[2 + j] -= 1.0
        for c in range(n_causes):
            rates[c] *= elastic
        spread(model, track, batch, rates, row, tensions_by[j])
    for axis in range(2):
        fill_place(scratch, n_joints, m, axis)
        spread(model, track, batch, scratch.rates[0], row, tip_by[axis])
    for c in range(at.surfaces, at.total):
        displacement = track.numbers[row, c]
        for axis in range(2):
            track.tip[row, axis] += tip_by[axis, c] * displacement
        for j in range(m):
            track.tensions[row, j] += tensions_by[j, c] * displacement


@part(inline=True)
def fill_place(scratch, link, m, axis):
    """Fill the first rates with those of a link's origin along an axis, by force, commands and surfaces."""
    state, turns, rates = scratch.state, scratch.causes, scratch.rates[0]
    x, y = state.pose[link, 0], state.pose[link, 1]
    for c in range(turns.shape[1]):
        rates[c] = 0.0
    for i in range(link):
        lever = state.contact[i, 1] - y if axis == 0 else x - state.contact[i, 0]
        for c in range(turns.shape[1]):
            rates[c] += lever * turns[i, c]
    for c in range(2 + m, turns.shape[1]):
        below, number = divmod(c - 2 - m, PER_JOINT)
        if below < link:
            cos, sin = state.pose[below, 3], state.pose[below, 4]
            dx, dy = scratch.values[below, number * (m + 2) + m], scratch.values[below, number * (m + 2) + m + 1]
            rates[c] += cos * dx - sin * dy if axis == 0 else sin * dx + cos * dy


@part(inline=True)
def spread(model, track, batch, rates, row, by):
    """From the derivatives of a quantity by force, commands and surfaces to those by all hidden numbers."""
    at, m = model.at, track.played.shape[1]
    by[0], by[1] = rates[0], rates[1]
    for j in range(m):
        by_command = rates[2 + j]
        factor = track.numbers[row, at.stiffnesses + j]
        stretch = batch.results.tensions[row, j] / (model.stiffnesses[j] * factor)
        by[at.offsets + j] = by_command
        by[at.stiffnesses + j] = -by_command * stretch / factor
        by[at.half_widths + j] = by_command * track.by_width[row, j]
        by[at.places + j] = by_command * track.by_place[row, j]
    for c in range(at.total - at.surfaces):
        by[at.surfaces + c] = rates[2 + m + c]
