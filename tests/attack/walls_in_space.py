"""Paths of chains in space among random walls, each step recomputed: gaps, wall forces, friction, joint moments."""

import numpy as np

from rollingjoint import (
    Bare,
    Capsule,
    InvalidInput,
    Plane,
    Sleeve,
    SpatialChain,
    Sphere,
    Surroundings,
    Tube,
    WallFriction,
    pitch_yaw,
    small_arm,
    solve_lengths,
)
from tests.attack.around_space import Recomputed, frame_of
from tests.attack.ledger import LONGEST

STEPS = 4
_LIMITS = (0.5, 30.0)
_CHAINS = (small_arm, lambda: SpatialChain.from_arm(small_arm()), pitch_yaw)
MOMENT, FORCE, GAP, STATE = 1e-6, 1e-6, 1e-9, 1e-6  # relative to the forces at work; mm; 1


def draw_walls(rng, chain, mu):
    """Random walls about a chain that stands upright, and its outline."""
    height, wide = chain.length, chain.hole_radius
    outline = Sleeve(rng.uniform(0.8, 1.1) * wide, int(rng.integers(1, 4)))
    if rng.random() < 0.3:
        outline = Bare(rng.uniform(0.1, 0.3) * wide, int(rng.integers(2, 4)), int(rng.integers(3, 7)))
    law = {"stiffness": 10.0 ** rng.uniform(-0.5, 1.0), "toe": 0.0 if rng.random() < 0.7 else rng.uniform(0.1, 1.0)}
    walls = []
    for _ in range(int(rng.integers(1, 4))):
        turn, up = rng.uniform(0.0, 2.0 * np.pi), height * rng.uniform(0.4, 1.0)
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        away = wide * rng.uniform(1.0, 1.5)
        match rng.choice(["plane", "sphere", "capsule", "tube"]):
            case "plane":
                walls.append(Plane(-out + rng.normal(0.0, 0.1, 3), -1.1 * away, **law))
            case "sphere":
                radius = wide * rng.uniform(0.3, 1.0)
                walls.append(Sphere((away + radius) * out + [0.0, 0.0, up], radius, **law))
            case "capsule":
                radius, way = wide * rng.uniform(0.1, 0.4), rng.normal(0.0, wide, 3)
                middle = (away + radius) * out + [0.0, 0.0, up]
                walls.append(Capsule(middle - way, middle + way, radius, **law))
            case "tube":
                ends = rng.normal(0.0, 0.3 * wide, (3, 3)) * [1.0, 1.0, 0.0]
                points = np.array([[0.0, 0.0, z * height] for z in (-0.5, 0.4, 0.8, 1.5)])
                points[1:] += ends
                walls.append(Tube.through(points, 1.1 * away + rng.uniform(0.0, 0.2, 4) * wide, 0.6 * height, **law))
    friction = WallFriction(mu, rng.uniform(0.03, 0.2)) if mu else None
    return Surroundings(walls, outline, friction)


def faults(case, result):
    """What is wrong with an equilibrium, {name: how far}; case: a Recomputed."""
    found, angles = {}, np.array(result.joint_angles)

    def note(name, off, most):
        if not off <= most:
            found[name] = off

    touching = case.contacts(angles)
    size = 1.0 + float(np.sum(result.tensions)) + sum(force for _, force, _, _ in touching)
    lever = case.chain.length
    free = result.free_joints
    note("joint moments", np.abs(case.residual(angles)[free]).max(initial=0.0) / (size * lever), MOMENT)
    note("gaps", np.abs(case.gaps(angles) - result.wall_gaps).max(), GAP)
    base, turned = frame_of(case.base), np.zeros((case.chain.n_links, 6))
    for c, _, _, wrench in touching:
        turned[case.candidates.pairs[c][0]] += wrench
    reported = np.zeros_like(turned)
    for k, (force, moment) in enumerate(np.array(result.wall_forces).reshape(-1, 2, 3)):
        place = base @ np.append(result.poses[k][:3, 3], 1.0)
        push = base[:3, :3] @ force
        reported[k] = *push, *(base[:3, :3] @ moment + np.cross(place[:3], push))
    note("wall forces", np.abs(reported - turned).max() / (size * lever), FORCE)
    for c, _, state, _ in touching:
        if state is not None:
            note("friction states", float(np.abs(result.walls.states[c] - state).max()), STATE * case.chain.length)
    note("friction cones", float(np.linalg.norm(result.walls.states, axis=-1).max(initial=0.0)), 1.0 + 1e-12)
    return found


def attack(rng, report):
    """One round: a path of a chain among walls."""
    chain = _CHAINS[rng.integers(len(_CHAINS))]()
    mu = float(rng.choice([0.0, 0.1, 0.3]))
    try:
        around = draw_walls(rng, chain, mu)
    except InvalidInput:  # a tube that folds or overlaps itself, a link that is shorter than its outline
        return
    command = chain.neutral_lengths - 2.0 / chain.stiffnesses
    base, history = np.concatenate([rng.normal(0.0, 0.5, 3), rng.normal(0.0, 0.02, 3)]), None
    for _ in range(STEPS):
        options = {"history": history} if mu and history is not None else {"start": history}
        with report.limited("a chain in space among walls", LONGEST):
            result = solve_lengths(chain, command, tension_limits=_LIMITS, surroundings=around, base=base, **options)
        past = None
        if mu and history is not None:
            states = np.zeros_like(result.walls.states) if history.walls.memory is None else history.walls.memory.states
            past = frame_of(history.walls.base) @ history.poses, states
        report.count("solves among walls in space", 1)
        report.count(f"status among walls in space {result.status.name}", 1)
        if not result.ok:
            return
        if result.walls.parts == 1:
            found = faults(Recomputed(chain, around, command, _LIMITS, base, past), result)
            report.count("solves among walls in space recomputed", 1)
            if result.wall_contacts:
                report.count("solves in contact in space", 1)
                if past is not None:
                    report.count("solves in contact in space: friction", 1)
            for name, off in found.items():
                report.fail(f"{name}: {off:.3g}")
        history = result
        command = command + rng.normal(0.0, 0.02 * chain.hole_radius, command.shape)
        base = base + np.concatenate([rng.normal(0.0, 0.1, 2), rng.normal(0.0, 1.0, 1), rng.normal(0.0, 0.005, 3)])
