"""Random mechanisms, loads and inputs of whole batches."""

import numpy as np

from rollingjoint import (
    Bead,
    BeadTendon,
    CapstanFriction,
    HingeChain,
    MechanismError,
    PointHinge,
    Profile,
    RollingContact,
    SpaceTendon,
    SpatialChain,
    Spring,
    Surface,
    TorsionSpring,
    five_link,
    flexible_arm,
    pitch_yaw,
    pitch_yaw_two_segment,
    small_arm,
    two_segment,
    uniform,
)
from rollingjoint.chain.random_chain import HARD_KINDS, hard_chain, hard_inputs, hard_loads, random_chain
from rollingjoint.load import load_table

_CHAINS = (five_link, two_segment, uniform, lambda: uniform(2), lambda: uniform(9), lambda: uniform(20))
_HUGE = (np.nan, np.inf, -np.inf, 1e13, -1e300)


def draw_friction(rng, rolls):
    """Coefficients of every kind, most of them common ones."""
    options = {}
    if rng.random() < 0.3:
        options["constant"] = rng.uniform(0.0, 0.3)
    if rng.random() < 0.3:
        options["compliance"] = rng.uniform(0.0, 0.05)
    if rng.random() < 0.3:
        options["extra_turn"] = rng.uniform(0.0, 0.3)
    if rolls and rng.random() < 0.2:
        options["rolling"] = rng.uniform(0.0, 0.5)
    return CapstanFriction(rng.uniform(0.0, 0.25), 10.0 ** rng.uniform(-1.7, -0.5), **options)


def draw_chain(rng, with_friction):
    """A planar chain, some with torsion springs of their own."""
    chain = random_chain(rng) if rng.random() < 0.6 else _CHAINS[rng.integers(len(_CHAINS))]()
    changes = {}
    if rng.random() < 0.25:
        links = rng.choice(chain.n_links, 2, replace=False).tolist()
        changes["springs"] = [TorsionSpring(links[0], rng.uniform(0.0, 30.0), rng.normal(0.0, 0.2), links[1])]
    if with_friction:
        changes["friction"] = draw_friction(rng, rolls=True)
    return chain.replace(**changes) if changes else chain


def draw_hard(rng, rows):
    """(chain, what is given, inputs, load table) of a chain that is hard to solve."""
    kind, given = str(rng.choice(HARD_KINDS)), str(rng.choice(["tensions", "lengths"]))
    chain = hard_chain(rng, kind)
    largest, follower = float(rng.choice([0.01, 1.5])), bool(rng.random() < 0.25)
    loads = hard_loads(rng, chain, kind, largest, follower) if rng.random() < 0.75 else []
    table = np.repeat(load_table(loads, chain.n_links)[None], rows, axis=0)
    return chain, given, hard_inputs(rng, chain, kind, given, rows), table


def draw_arm(rng, with_friction):
    """An arm of beads of any size, axis and rest angle; tendons of any holes and ends."""
    friction = draw_friction(rng, rolls=False) if with_friction else None
    kind = rng.random()
    if kind < 0.3:
        arm = small_arm(int(rng.integers(1, 12))) if kind < 0.25 else flexible_arm()
        return arm.replace(friction=friction)
    while True:
        n = int(rng.integers(1, 9))
        beads = [
            Bead(rng.uniform(15, 30), rng.normal(size=3), rng.uniform(200, 900), rng.uniform(4, 12), 0.2,
                 rng.normal() / 20, (-rng.uniform(0.3, 1.5), rng.uniform(0.3, 1.5)))
            for _ in range(n)
        ]  # fmt: skip
        tendons = []
        for angle in rng.uniform(0, 2 * np.pi, int(rng.integers(1, 6))):
            end = int(rng.integers(1, n + 1))
            holes = 12 * np.array([np.cos(angle), np.sin(angle)]) + 0.3 * rng.normal(size=(end + 1, 2))
            tendons.append(BeadTendon(holes, end, rng.uniform(3, 12)))
        try:
            arm = HingeChain(beads, tendons, friction=friction)
        except MechanismError:  # holes that meet at rest
            continue
        if np.all(np.diff(arm.joint_limits) > 0.05):
            return arm


def draw_space(rng, with_friction):
    """A chain in space of rolling contacts, hinges or both; most surfaces and holes differ from link to link."""
    friction = draw_friction(rng, rolls=True) if with_friction else None
    kind = rng.random()
    if kind < 0.2:
        n, spring = int(rng.integers(1, 9)), float(rng.choice([0.0, 2.0, 20.0]))
        chain = pitch_yaw(n, joint_stiffness=spring) if kind < 0.1 else pitch_yaw_two_segment(n, 3)
        return chain.replace(friction=friction)
    while True:
        try:
            chain = _space_chain(rng, friction)
        except MechanismError:  # holes that cross
            continue
        if np.all(np.diff(chain.joint_limits) > 1e-3):
            return chain


def _space_chain(rng, friction):
    n = int(rng.integers(17, 33) if rng.random() < 0.1 else rng.integers(1, 9))
    hinged = rng.random(n) < rng.choice([0.0, 0.4, 1.0], p=[0.5, 0.4, 0.1])
    joints = [_space_hinge(rng) if each else _contact(rng) for each in hinged]
    tendons, face = [], float(rng.choice([1.8, 2.5, 3.0]))
    for angle in rng.uniform(0, 2 * np.pi, int(rng.integers(1, 7))):
        end = int(rng.integers(1, n + 1))
        if rng.random() < 0.3 and not hinged[0]:  # in the plane of the first joint's axis, face to face at its apex
            angle = joints[0].azimuth + 0.5 * np.pi
        scatter = rng.choice([0.0, 0.1]) * rng.normal(size=end + 1)
        winding = angle + rng.choice([0.0, 0.3]) * np.arange(end + 1) + scatter
        x, y = 2.5 * np.cos(winding), 2.5 * np.sin(winding)
        z = np.full(end + 1, face)
        holes = np.stack([np.stack([x, y, -z], -1), np.stack([x, y, z], -1)], axis=1)
        tendons.append(SpaceTendon(holes, end, 10.0 ** rng.uniform(0.0, 2.0)))
    link = int(rng.integers(1, n + 1))
    springs = [TorsionSpring(link, rng.uniform(0.0, 30.0), 0.2 * rng.normal(), link - 1)] if rng.random() < 0.2 else []
    if rng.random() < 0.2:
        springs.append(Spring(link, 0.03, tuple(5.0 * rng.normal(size=3)), tuple(rng.normal(size=3))))
    return SpatialChain(joints, tendons, name="space", friction=friction, springs=springs)


def _space_hinge(rng):
    axis = rng.normal(size=3) * [1.0, 1.0, 0.3]
    below, above = rng.normal([[0.0, 0.0, 3.2], [0.0, 0.0, -3.2]], 0.2)
    limits = -rng.uniform(0.2, 1.5), rng.uniform(0.2, 1.5)
    return PointHinge(axis, below, above, float(rng.choice([0.0, 3.0, 30.0])), 0.1 * rng.normal(), limits)


def _contact(rng):
    """Circles, cubics, curvatures that jump, or a relative curvature that nearly vanishes at one place."""
    half = rng.uniform(0.5, 2.5)
    limits = (-half, half)
    child, parent = Profile.constant(-rng.uniform(0.1, 0.3), limits), Profile.constant(rng.uniform(0.0, 0.3), limits)
    match rng.choice(["circles", "cubic", "jumps", "flat"]):
        case "cubic":
            child = Profile.polynomial([-rng.uniform(0.14, 0.25), *rng.normal(0.0, [0.006, 0.001])], limits)
        case "jumps":
            breaks = [-half, *np.sort(rng.uniform(-half, half, 2)), half]
            child = Profile.piecewise_constant(breaks, -(10.0 ** rng.uniform(-3.0, 0.0, 3)))
        case "flat":
            s = np.unique([-half, rng.uniform(-half, half), half])
            smallest, slope = 10.0 ** rng.uniform(-7.0, -3.0), 10.0 ** rng.uniform(-1.5, -0.5)
            child, parent = Profile.samples(s, -smallest - slope * np.abs(s - s[1])), Profile.constant(0.0, limits)
    tilts, sides = rng.choice([0.0, 0.1], 2) * rng.normal(size=2), rng.choice([0.0, 0.2], 2) * rng.normal(size=2)
    surfaces = Surface(parent, (sides[0], -3.0), tilts[0]), Surface(child, (sides[1], 3.0), tilts[1])
    azimuth = float(rng.choice([0.0, 0.5 * np.pi, rng.uniform(-np.pi, np.pi)]))
    spring = float(rng.choice([0.0, 3.0, 30.0])), 0.1 * rng.normal()
    return RollingContact(azimuth, *surfaces, 3.0, float(rng.choice([0.0, 0.3])), *spring)


def draw_space_loads(rng, chain, rows, dead):
    """A load table (B, rows of the table, columns): as on arms, weaker; now and then huge."""
    table = draw_arm_loads(rng, chain, rows, dead)
    factors = np.where(rng.random(rows) < 0.02, 1e3, 10.0 ** rng.uniform(-1.5, 0.0, rows))
    table[:, :, 1:4] *= 0.3
    table[:, :, 4:17] *= factors[:, None, None]
    table[:, :, 20] *= 0.1
    return table


def draw_planar_loads(rng, chain, rows, dead):
    """A load table (B, rows of the table, columns); `dead` for what has a potential."""
    count = int(rng.integers(0, 4))
    table = np.zeros((rows, count, 14))
    for load in np.moveaxis(table, 1, 0):
        load[:, 0] = rng.integers(1, chain.n_links, rows)
        load[:, 1:3] = rng.normal(0.0, 3.0, (rows, 2))
        match rng.choice(["force", "moment", "spring", "torsion", "follower"], p=[0.5, 0.15, 0.15, 0.1, 0.1]):
            case "force":
                load[:, 3:5] = rng.normal(0.0, 0.5, (rows, 2))
            case "moment":
                load[:, 7] = rng.normal(0.0, 8.0, rows)
            case "spring":
                load[:, 8] = rng.uniform(0.0, 0.1, rows)
                load[:, 9:11] = rng.uniform(-50.0, 100.0, (rows, 2))
            case "torsion":
                load[:, 11], load[:, 12] = rng.uniform(0.0, 20.0, rows), rng.normal(0.0, 0.3, rows)
            case "follower" if not dead:
                load[:, 5:7] = rng.normal(0.0, 0.3, (rows, 2))
    return table


def draw_arm_loads(rng, arm, rows, dead):
    """A load table (B, rows of the table, columns)."""
    count = int(rng.integers(0, 4))
    table = np.zeros((rows, count, 23))
    for load in np.moveaxis(table, 1, 0):
        load[:, 0] = rng.integers(1, arm.n_links, rows)
        load[:, 1:4] = rng.normal(0.0, 3.0, (rows, 3))
        match rng.choice(["force", "spring", "torsion", "moment", "follower"], p=[0.6, 0.15, 0.1, 0.1, 0.05]):
            case "force":
                load[:, 4:7] = rng.normal(0.0, 0.4, (rows, 3))
            case "spring":
                load[:, 16] = rng.uniform(0.0, 0.03, rows)
                load[:, 17:20] = rng.uniform(-100.0, 200.0, (rows, 3))
            case "torsion":  # about one hinge: those beside it have other axes
                load[:, 20:22] = np.column_stack([rng.uniform(0.0, 300.0, rows), rng.normal(0.0, 0.3, rows)])
                load[:, 22] = load[:, 0] - 1
            case "moment" if not dead:
                load[:, 7:10] = rng.normal(0.0, 10.0, (rows, 3))
            case "follower" if not dead:
                load[:, 10:16] = rng.normal(0.0, 0.2, (rows, 6))
    return table


def draw_inputs(rng, mechanism, given, rows):
    """Tensions [N] or lengths [mm], (B, m)."""
    m = mechanism.n_tendons
    if given == "tensions":
        return 10.0 ** rng.uniform(-1.0, 1.3, (rows, m)) * (rng.random((rows, m)) >= 0.05)
    return mechanism.neutral_lengths + mechanism.length * rng.uniform(-0.08, 0.02, (rows, m))


def spoil(rng, inputs, starts, tables):
    """Make one number of some rows unusable; returns which rows."""
    rows = rng.random(len(inputs)) < 0.01
    for row in np.flatnonzero(rows):
        columns = [inputs[row], starts[row], *(load[1:7] for load in tables[row])]  # a link is refused at once
        column = columns[rng.integers(len(columns))]
        column[rng.integers(len(column))] = _HUGE[rng.integers(len(_HUGE))]
    return rows
