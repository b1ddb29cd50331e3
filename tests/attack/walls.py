"""Paths of planar chains among random walls, each step recomputed: gaps, wall forces, friction, balance."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rollingjoint import (
    Bare,
    CapstanFriction,
    Capsule,
    Disc,
    HalfPlane,
    InvalidInput,
    Lumen,
    Polygon,
    Sleeve,
    Status,
    Surroundings,
    WallFriction,
    five_link,
    solve_lengths_batch,
    two_segment,
    uniform,
)
from rollingjoint.chain.solution import stacked
from tests.attack import drawing, solves
from tests.attack.around import Candidates
from tests.attack.ledger import LONGEST

ROWS, STEPS = 64, 4
_LIMITS = (0.5, 15.0)
_CHAINS = (
    five_link,
    two_segment,
    uniform,
    lambda: uniform(9),
    lambda: two_segment(4, 4, height=10.0, radius=7.0, half_width=5.0),
)
FORCE, GAP = 1e-6, 1e-9  # N and N·mm; mm
_PUSHED = 1e-6  # mm: a rigid wall that is entered farther has failed


@dataclass
class WallCase(solves.Case):
    """A case among walls."""

    around: Any = None
    bases: Any = None
    history: Any = None  # the equilibria before
    memory: Any = None  # of contacts: pressed, states, ways, sides; as recomputed
    candidates: Any = None

    def solve(self, rows=slice(None)):
        """The equilibria of some rows."""
        options = {"loads": self.tables[rows], "starts": self.starts[rows], "tension_limits": self.limits}
        if self.history is not None:
            options["history"] = self.history if rows == slice(None) else _rows_of(self.history, rows)
        return solve_lengths_batch(
            self.mechanism, self.inputs[rows], surroundings=self.around, base=self.bases[rows], **options
        )

    def contact(self, result):
        """(fields, normal forces, friction states), (C, B), recomputed; rigid walls keep the result's forces."""
        fields = self.candidates.fields(result.poses, result.walls.base)
        forces = result.walls.normals.T if self.candidates.rigid else self.candidates.normal_forces(fields[0])
        states = np.zeros_like(forces) if self.memory is None else self.candidates.states(fields, self.memory)
        states = np.where(result.walls.parts > 1, result.walls.states.T, states)  # on a way that is not known here
        return fields, forces, np.where(self.candidates.mu[:, None] > 0.0, states, 0.0)

    def faults(self, result, expected_invalid):
        """What is wrong, {name: (rows, how far)}, and how many rows were recomputed."""
        rows = np.flatnonzero(Status.usable(result.status))
        fields, forces, states = self.contact(result)
        self.outside = self.candidates.wrenches(np.array(result.poses), np.array(result.walls.base), forces, states)
        found, clear = super().faults(result, expected_invalid)
        for name in {"gap tensions", "friction states", "slips"} & found.keys():  # on a way that is not known here
            wrong, off = found.pop(name)
            solves._note(found, name, result.walls.parts[wrong] == 1, wrong, np.full(len(wrong), off))
        if not rows.size:
            return found, clear
        n = len(result.status)
        turning = np.stack([*np.moveaxis(self.outside[0], -1, 0), self.outside[1]], axis=-1)
        x, y = np.moveaxis(result.poses[..., :2], -1, 0)
        reported = np.array(result.wall_forces)
        reported[..., 2] += x * reported[..., 1] - y * reported[..., 0]
        off = np.abs(reported - turning).reshape(n, -1).max(axis=1) / (1.0 + forces.sum(axis=0))
        solves._note(found, "wall forces", off[rows] > FORCE, rows, off[rows])
        pressing = result.walls.normals.T > 0.0
        if self.candidates.rigid:
            entered = -fields[0].min(axis=0)
            solves._note(found, "rigid walls entered", entered[rows] > _PUSHED, rows, entered[rows])
            pushed = np.where(pressing, np.abs(fields[0]), 0.0).max(axis=0)
            solves._note(found, "rigid walls press from afar", pushed[rows] > _PUSHED, rows, pushed[rows])
            solves._note(found, "rigid walls pull", (result.walls.normals.min(axis=1) < 0.0)[rows], rows)
        else:
            other = ((forces > 0.0) != pressing) & (np.abs(fields[0]) > GAP)
            solves._note(found, "contacts that press", other.any(axis=0)[rows], rows)
        cone = np.abs(result.walls.states).max(axis=1)
        solves._note(found, "friction cones", cone[rows] > 1.0, rows, cone[rows])
        if self.memory is not None:
            rubs = pressing & (self.candidates.mu[:, None] > 0.0)
            off = np.where(rubs, np.abs(states - result.walls.states.T), 0.0).max(axis=0)
            solves._note(found, "friction states of walls", off[rows] > 1e-5, rows, off[rows])
        return found, clear


def _rows_of(history, rows):
    return stacked([history.row(row) for row in range(*rows.indices(len(history.status)))])


def draw_walls(rng, chain, mu):
    """Random walls about a chain that stands upright, and its outline."""
    height = float(chain.poses(np.array(chain.neutral_angles))[-1, 1])
    rigid = bool(rng.random() < 0.2)
    width = rng.uniform(3.0, 6.0)
    outline = Sleeve(width, int(rng.integers(1, 4))) if rng.random() < 0.7 else Bare(rng.uniform(0.3, 1.0))
    reach = width if isinstance(outline, Sleeve) else 9.0
    law = {
        "stiffness": 10.0 ** rng.uniform(-0.5, 1.0),
        "toe": 0.0 if rigid or rng.random() < 0.7 else rng.uniform(0.1, 1.0),
    }
    walls = []
    for _ in range(int(rng.integers(1, 4))):
        side, up = float(rng.choice([-1.0, 1.0])), height * rng.uniform(0.4, 1.0)
        away = side * (reach + rng.uniform(0.5, 12.0))
        match rng.choice(["plane", "disc", "capsule", "polygon", "lumen"]):
            case "plane":
                walls.append(HalfPlane((-side, rng.normal(0.0, 0.1)), -abs(away) - rng.uniform(0.0, 8.0), **law))
            case "disc":
                radius = rng.uniform(2.0, 6.0)
                walls.append(Disc((away + side * radius, up), radius, **law))
            case "capsule":
                radius, slope = rng.uniform(0.5, 3.0), rng.normal(0.0, 4.0)
                walls.append(
                    Capsule((away + side * radius, up), (away + side * (radius + abs(slope)), up + 12.0), radius, **law)
                )
            case "polygon":
                x = away + side * 0.5
                walls.append(Polygon([(x, up), (x + side * 9.0, up - 6.0), (x + side * 9.0, up + 6.0)], 0.5, **law))
            case "lumen" if not rigid:
                bends = rng.uniform(-0.015, 0.015, 3)
                radii = reach + rng.uniform(1.0, 4.0) - (0.0 if mu else rng.uniform(0.0, 0.5, 4))
                radii = float(radii) if mu else radii.tolist()
                walls.append(Lumen(rng.uniform(25.0, 45.0, 3).tolist(), bends.tolist(), radii, **law))
    if not walls:
        walls.append(HalfPlane((-1.0, 0.0), -reach - 5.0, **law))
    friction = WallFriction(mu, rng.uniform(0.03, 0.2)) if mu else None
    return Surroundings(walls, outline, friction, rigid)


def cases(rng):
    """Case after case of one path."""
    chain = _CHAINS[rng.integers(len(_CHAINS))]()
    mu = float(rng.choice([0.0, 0.1, 0.3]))
    if rng.random() < 0.3:
        chain = chain.replace(friction=CapstanFriction(rng.uniform(0.05, 0.2), rng.uniform(0.03, 0.2)))
    try:
        around = draw_walls(rng, chain, mu)
        candidates = Candidates(chain, around)
    except InvalidInput:  # a lumen that folds, a link that is narrower than its outline
        return
    tables = drawing.draw_planar_loads(rng, chain, ROWS, dead=True)
    starts = np.repeat(np.array(chain.neutral_angles)[None], ROWS, axis=0)
    rest = chain.neutral_lengths - 2.0 / chain.stiffnesses
    case = WallCase(chain, "lengths", np.repeat(rest[None], ROWS, axis=0), tables, starts, _LIMITS)
    case.around, case.candidates = around, candidates
    case.bases = rng.normal(0.0, [0.3, 2.0, 0.02], (ROWS, 3))
    for step in range(STEPS + 1):
        yield case
        if step == STEPS:
            return
        case.inputs = case.inputs + rng.normal(0.0, 0.8, case.inputs.shape)
        case.bases = case.bases + rng.normal(0.0, [0.2, 2.0, 0.01], (ROWS, 3))


def attack(rng, report):
    """One round: a path of a batch of chains among walls."""
    for case in cases(rng):
        with report.limited("a batch among walls", 4.0 * LONGEST):
            result = case.solve()
        found, checked = case.faults(result, np.zeros(ROWS, bool))
        report.count("solves among walls", ROWS)
        report.count("solves among walls recomputed", checked)
        touching = (result.walls.normals > 0.0).any(axis=1) & result.ok
        report.count("solves in contact", int(touching.sum()))
        if case.candidates.rigid:
            report.count("solves in contact: rigid walls", int(touching.sum()))
        if case.memory is not None and case.candidates.mu.any():
            report.count("solves in contact: friction at walls", int(touching.sum()))
        for status in Status:
            report.count(f"status among walls {status.name}", int(np.sum(np.asarray(result.status) == status)))
        for name, (rows, off) in found.items():
            report.fail(f"{name}: {len(rows)} rows, worst {off:.3g}, first {rows[0]}")
        row = int(rng.integers(ROWS))
        alone = case.solve(slice(row, row + 1))
        for name in ("joint_angles", "poses", "tensions", "wall_forces", "status"):
            if not np.array_equal(getattr(alone, name)[0], getattr(result, name)[row]):
                report.fail(f"row {row} alone has other {name} among walls")
        if not np.all(result.ok):  # steps that were refused, or failed: their histories are not those of this path
            return
        fields, forces, states = case.contact(result)
        case.memory = forces > 0.0, np.where(forces > 0.0, states, 0.0), fields[1], fields[2]
        case.history, case.starts = result, np.array(result.joint_angles)
        case.before = result.friction_state if case.mechanism.has_friction else None
