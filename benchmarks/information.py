"""How well the tip can be known where nobody sees it, from what controllers of the instrument worlds read.

    python benchmarks/information.py

A controller drives episodes. For each of them the motors' positions and the noisy tensions of all its steps are
differentiated by everything that is hidden (displaced surfaces, load, offsets of the motors, stiffnesses, play, sheath
friction, where tendons began in their play) at its true values, and so is the tip at the end. Taken as normal, with
the variances that the world draws them with, the hidden numbers then have a distribution given the readings, and the
tip has one: what is printed is the mean distance of the tip from where it is most likely.

That is an estimate of what can be known along these motions, not a bound. The derivatives know on which side of its
play every tendon is, which makes it too small. They take uniform distributions as normal ones, and where motors are
after the start as given, although where a motor gives way at the limit of tension tells something: both make it too
large. Episodes whose tips this model does not find again from the motors' positions are left out of both figures.

An arm has more hidden numbers: gravity, payload, offsets, stiffnesses, play, sheath friction and places in the play of
all tendons, friction in the holes of the beads, and stiffness and weight of every bead. Their derivatives are exact,
and a motor that gives way tells that its tension is at the limit.

Chains with the motors of a rig (version 1), and those whose load wanders, are followed by the smoother's exact
derivatives, which take displaced surfaces linearly about the nominal ones. Load cells err there, pictures count at the
step that they were taken in, and every step has a force of its own. What is read after the last action is left out:
the load moves on in the last step, and no controller can know where to.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from agents.controllers.arm_smoother import arm_law, arm_ranges
from agents.controllers.controller import Controller, Reading
from agents.controllers.smoother import SmootherFeedbackSettings, SmootherSettings, smoother_of
from agents.controllers.tuned import tuned_controllers
from agents.policies.loading import shipped_policies
from agents.runs.environment import EnvConfig, make_vector_env
from agents.shipped import load_policy
from rj_gym.tracking.config import TrackingConfig
from rollingjoint import WorldForce, five_link, solve_lengths_batch, solve_tensions_batch
from rollingjoint.chain.variations import ChainVariations
from rollingjoint.estimate import ArmPrior, ArmRows, FollowedArm, HiddenPrior, MotorHistory
from rollingjoint.estimate.arm_rows import tip_covariance
from rollingjoint.estimate.arrays import Track
from rollingjoint.load import load_table
from rollingjoint.tables import markdown_table
from rollingjoint.transmission import play_step, sheath_direction, sheath_ratio

Array = NDArray[np.float64]

POLICIES = {"Instrument": "instrument", "InstrumentShift": "instrument_shift"}  # that ship, by world
ARM_DRIVERS = "probing filter", "smoother"
ARMS = {"ArmInstrument": "rj_gym/ArmInstrument-v0", "ArmInstrument-v1": "rj_gym/ArmInstrument-v1"}
CHAINS = {
    "Instrument-v1": "rj_gym/Instrument-v1",
    "InstrumentShift-v1": "rj_gym/InstrumentShift-v1",
    "SlowCamera": "rj_gym/SlowCamera-v0",
    "SlowCamera-v1": "rj_gym/SlowCamera-v1",
    "LatePose": "rj_gym/LatePose-v0",
    "LatePose-v1": "rj_gym/LatePose-v1",
}

FIRST_SEED = 5_500_000  # of episodes that nothing was tuned or chosen on
ENCODER_SD = 1e-3  # mm: of motor positions, which are measured exactly
REACH = 1e-3  # standard deviations: of the central differences
SAME = 1e-6  # mm: by how much the model may miss the environment's tips
SAME_ARM = 1e-4  # mm: friction has its own tolerance
SAME_CHAIN = 1.0  # mm: displaced surfaces are taken linearly
ANY = 1e4  # standard deviations: residuals are of no account, so none is too large
LIMIT_SD = 0.01  # N: of the tension at which a motor gives way
YIELD = 1e-6  # mm: a motor that is farther from where it was asked to go has given way


class Hidden(NamedTuple):
    """Hidden numbers of B episodes, or their standard deviations (B = 1)."""

    surfaces: Array  # (B, 5, 2, 3) mm, rad
    force: Array  # (B, 2) N
    offsets: Array  # (B, m) mm
    stiffness: Array  # of tendons, over the nominal one, (B, m)
    play: Array  # (B, m) mm
    sheath: Array  # (B, m)
    place: Array  # of the motor in its play at the start, from -1/2 to 1/2, (B, m)

    def vectors(self) -> Array:
        """(B, K)."""
        return np.concatenate([each.reshape(len(each), -1) for each in self], axis=1)

    @classmethod
    def of(cls, vectors: Array) -> Hidden:
        """From (B, K)."""
        shapes = ((5, 2, 3), (2,), (2,), (2,), (2,), (2,), (2,))
        stops = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
        return cls(
            *(part.reshape(-1, *shape) for part, shape in zip(np.split(vectors, stops, axis=1), shapes, strict=True))
        )


class Driven(NamedTuple):
    """Episodes as a controller drove them."""

    config: TrackingConfig
    hidden: Hidden
    motors: Array  # (B, T + 1, m) mm
    tips: Array  # (B, T + 1, 2) mm
    errors: Array  # of the last step, (B,) mm


def spreads(config: TrackingConfig) -> Array:
    """Standard deviations of the hidden numbers as the world draws them, (K,)."""
    random, actuation = config.randomization, config.actuation

    def both(width: float) -> Array:
        return np.full((1, 2), width / np.sqrt(12))

    surfaces = np.array([random.link_tolerance_mm, random.link_tolerance_mm, random.link_tolerance_rad]) / np.sqrt(3)
    return Hidden(
        surfaces=np.broadcast_to(surfaces, (1, 5, 2, 3)),
        force=np.full((1, 2), config.load.magnitude[1] / np.sqrt(6)),  # any direction, up to this magnitude
        offsets=both(2 * random.actuator_offset_mm),
        stiffness=both(2 * random.stiffness_spread),
        play=both(np.ptp(actuation.play_mm)),
        sheath=both(np.ptp(actuation.sheath_friction)),
        place=both(1.0),
    ).vectors()[0]


class Watched(NamedTuple):
    """Episodes of an environment under a controller."""

    task: Any
    drawn: dict[str, Any]  # info["sampled"]
    motors: Array  # (B, T + 1, m) mm
    shifts: Array  # how far motors have given way in a step, (B, T + 1, m) mm
    tips: Array  # (B, T + 1, d) mm
    errors: Array  # of the last step, (B,) mm
    ages: Array  # of a picture that comes in a step, (B, T + 1) steps; NaN where none does


def _picture_age(observation: Any, task: Any) -> Array:
    """The ages of pictures that come now, (B,) [steps]; NaN where none does."""
    reading = Reading(observation, task)
    if reading.sees == "none":
        return np.full(len(observation), np.nan)
    return np.where(reading.picture_is_new, reading.picture_age, np.nan)


def watch(env: EnvConfig, controller: Controller, episodes: int) -> Watched:
    """Episodes of the first seeds under the controller."""
    envs = make_vector_env(env, episodes)
    envs.autoreset_mode = AutoresetMode.DISABLED
    observation, info = envs.reset(seed=list(range(FIRST_SEED, FIRST_SEED + episodes)))
    drawn, scale, actuation = info["sampled"], envs.task.config.action_scale_mm, envs.task.config.actuation
    most = 0.0 if actuation.limit_at == "motor" else np.inf  # where motors stop, tendons do not move
    controller.begin(envs.task, episodes)
    tangents, ages = [envs.tangent()], [_picture_age(observation, envs.task)]
    shifts = [np.zeros_like(tangents[0].motors)]
    for _ in range(envs.task.config.episode_steps):
        actions = np.clip(controller.act(observation), -1.0, 1.0).astype(np.float32)
        observation, _, _, _, info = envs.step(actions)
        tangents.append(envs.tangent())
        ages.append(_picture_age(observation, envs.task))
        ways = tangents[-1].motors - (tangents[-2].motors - scale * actions)
        shifts.append(np.where(np.abs(ways) > YIELD + 2.0 * actuation.dead_band_mm, np.minimum(ways, most), 0.0))
    envs.close()
    motors, tips = (np.stack([getattr(each, name) for each in tangents], axis=1) for name in ("motors", "tips"))
    return Watched(envs.task, drawn, motors, np.stack(shifts, axis=1), tips, info["error_mm"], np.stack(ages, axis=1))


def drive(env: EnvConfig, controller: Controller, episodes: int) -> Driven:
    """Episodes of an instrument of these seeds under the controller."""
    watched, nominal = watch(env, controller, episodes), five_link()
    drawn = watched.drawn
    hidden = Hidden(
        drawn.get("surface_offsets", np.zeros((episodes, 5, 2, 3))), drawn["forces"][:, 0], drawn["actuator_offsets"],
        drawn["stiffnesses"] / nominal.stiffnesses, drawn["play_mm"], drawn["sheath_friction"],
        drawn["motor_starts"] / drawn["play_mm"],
    )  # fmt: skip
    return Driven(watched.task.config, hidden, watched.motors, watched.tips, watched.errors)


def follow_arm(watched: Watched) -> tuple[ArmPrior, ArmRows]:
    """What is known of an arm before its episodes, and their true hidden numbers followed along them."""
    config, arm, drawn = watched.task.config, watched.task.mechanism, watched.drawn
    prior = ArmPrior.of(arm, arm_ranges(config))
    mu = drawn["friction_mu"][:, : prior.layout.hinges - prior.layout.holes]
    cells = [drawn["tension_gains"], drawn["tension_offsets"]] if config.sensing.cells_err else []
    truth = np.hstack([
        drawn["gravity"][:, :2], drawn["payloads"][:, :1], drawn["actuator_offsets"],
        drawn["stiffnesses"] / arm.stiffnesses, 0.5 * drawn["play_mm"], drawn["sheath_friction"],
        drawn["motor_starts"] / drawn["play_mm"], *cells, np.maximum(mu, prior.low[prior.layout.holes]),
        drawn["hinge_stiffnesses"] / arm.joint_stiffnesses, drawn["weights"] / arm.weights,
    ])  # fmt: skip
    law = arm_law(config, ENCODER_SD, LIMIT_SD, config.sensing.tension_noise, robust=np.inf)
    episodes, steps, _ = watched.motors.shape
    unread = np.zeros_like(watched.motors)  # tensions count by their derivatives alone
    pictures = np.zeros((episodes, steps, 0, 3))
    history = MotorHistory(np.full(episodes, steps), watched.motors, watched.shifts, unread, pictures)
    return prior, FollowedArm(arm, prior, law).followed(history, np.arange(episodes), truth)


def arm_estimates(env: EnvConfig, controller: Controller, episodes: int) -> list[str]:
    """Error of the controller, and estimates of what can be known from what it read: a row of the arms' table."""
    watched = watch(env, controller, episodes)
    prior, rows = follow_arm(watched)
    usable = np.linalg.norm(rows.tip - watched.tips[:, -1], axis=1) < SAME_ARM
    at, known = prior.layout, [prior.sds.copy() for _ in range(3)]
    known[1][at.offsets : at.stiffnesses] = 0.0
    known[2][at.hinges :] = 0.0
    estimates = [[distance(each) for each in rows.tip_covariance(sds)[usable]] for sds in known]
    return [f"{watched.errors[usable].mean():.2f}", *map(interval, estimates), f"{usable.sum()} of {episodes}"]


def chain_numbers(watched: Watched, prior: HiddenPrior) -> Array:
    """The true hidden numbers of chains as a smoother has them, (B, K); a force that wanders as it began."""
    drawn, at, none = watched.drawn, prior.layout, np.zeros_like(watched.motors[:, 0])
    play, displaced = drawn.get("play_mm", none), drawn.get("surface_offsets", np.zeros((len(none), 2, 2, 3)))
    surfaces = np.stack([displaced[:, :-1, 1], displaced[:, 1:, 0]], axis=2).reshape(len(none), -1)
    return np.hstack([
        drawn["forces"][:, 0], drawn["actuator_offsets"],
        drawn["stiffnesses"] / watched.task.mechanism.stiffnesses, 0.5 * play, drawn.get("sheath_friction", none),
        np.divide(drawn.get("motor_starts", none), play, out=none.copy(), where=play > 0.0),
        drawn.get("tension_gains", none + 1.0), drawn.get("tension_offsets", none),
        surfaces[:, : at.total - at.surfaces],
    ])  # fmt: skip


def follow_chain(watched: Watched, last: bool = False, limit_sd: float = LIMIT_SD) -> tuple[HiddenPrior, Track]:
    """What is known of chains before their episodes, and their true hidden numbers followed along them.

    Args:
        last: whether what is read in the last step counts. limit_sd: of the tension at which a motor gives way [N];
            0: that tells nothing.
    """
    config, episodes = watched.task.config, len(watched.motors)
    exact = {"robust": ANY, "start_sd_mm": ENCODER_SD, "limit_sd": limit_sd}
    settings = SmootherSettings(tension_sd=config.sensing.tension_noise, **exact)
    smoother = smoother_of(watched.task, SmootherFeedbackSettings(smoother=settings))
    smoother.reset(np.ones(episodes, bool))
    steps, pictures = watched.motors.shape[1], np.zeros((episodes, watched.task.mechanism.n_joints, 3))
    for step in range(steps):
        counts, ages = step < steps - 1 or last, watched.ages[:, step]
        tensions = np.full_like(watched.motors[:, step], 0.0 if counts else np.nan)
        come = np.where(np.isfinite(ages)[:, None, None] & counts, pictures, np.nan)
        shown = () if config.sensing.pose == "none" else (come, np.nan_to_num(ages).astype(np.int64))
        smoother.append(watched.motors[:, step], watched.shifts[:, step], tensions, *shown)
    truth, forces = chain_numbers(watched, smoother.prior), None
    if config.load.process == "ou":
        before = int(smoother.history.counts[0]) - steps  # a step that shows the start tension
        forces = np.concatenate([watched.drawn["forces"][:, :before], watched.drawn["forces"]], axis=1)
    first = np.zeros(episodes, np.int64)
    which = np.arange(episodes), watched.drawn["link"].astype(np.int64), first
    return smoother.prior, smoother.fine.followed(smoother.history, *which, truth, forces)


def chain_estimates(env: EnvConfig, controller: Controller, episodes: int) -> list[str]:
    """A row of the table: error of the controller, what can be known before its last action, last mean tension."""
    watched = watch(env, controller, episodes)
    prior, track = follow_chain(watched)
    usable = np.linalg.norm(track.tip - watched.tips[:, -1], axis=1) < SAME_CHAIN
    exact = prior.sds.copy()
    exact[prior.layout.surfaces :] = 0.0
    estimates = [
        [distance(each) for each in tip_covariance(track.information, track.tip_by, sds)[usable]]
        for sds in (prior.sds, exact)
    ]
    tension = f"{track.tensions[usable].mean():.1f}"
    return [f"{watched.errors[usable].mean():.3f}", *map(interval, estimates), tension, f"{usable.sum()} of {episodes}"]


def follow(config: TrackingConfig, hidden: Hidden, motors: Array) -> tuple[Array, Array, Array]:
    """Motors at the start (B, m), measured tensions (B, T + 1, m) and tips (B, T + 1, 2) of such instruments.

    Args:
        motors: where the motors go, (B, T + 1, m) [mm].
    """
    nominal = five_link()
    chains = ChainVariations(nominal, hidden.surfaces, hidden.stiffness)
    loads = np.array([load_table([WorldForce(-1, tuple(force))], nominal.n_links) for force in hidden.force])
    equilibria = solve_tensions_batch(chains, np.full(hidden.play.shape, config.start_tension))
    tendons = equilibria.lengths - config.start_tension / chains.stiffnesses
    begin, half = tendons + hidden.place * hidden.play, 0.5 * hidden.play
    measured, tips = [], []
    for step in range(motors.shape[1]):
        at = motors[:, step] if step else begin
        tendons = play_step(tendons, at, half)
        equilibria = solve_lengths_batch(
            chains, tendons + hidden.offsets, loads, starts=equilibria, tension_limits=config.tension_range
        )
        measured.append(equilibria.tensions * sheath_ratio(hidden.sheath, sheath_direction(tendons, at, half)))
        tips.append(equilibria.tip)
    return begin, np.stack(measured, axis=1), np.stack(tips, axis=1)


def expected_error(config: TrackingConfig, hidden: Array, motors: Array, sds: Array) -> float:
    """Mean distance of the tip at the end of one episode from where it is most likely [mm].

    Args:
        hidden: true numbers (K,). motors: (T + 1, m). sds: of the hidden numbers; those with 0 are known.
    """
    unknown = np.flatnonzero(sds)
    count, changes = len(unknown), REACH * np.diag(sds)[unknown]
    rows = Hidden.of(np.concatenate([hidden + changes, hidden - changes]))
    begin, measured, tips = (
        (found[:count] - found[count:]).reshape(count, -1) / (2 * REACH)
        for found in follow(config, rows, np.repeat(motors[None], 2 * count, axis=0))
    )
    noise = config.sensing.tension_noise
    information = np.eye(count) + measured @ measured.T / noise**2 + begin @ begin.T / ENCODER_SD**2
    tip = tips[:, -2:]
    covariance = tip.T @ np.linalg.solve(information, tip)
    return distance(covariance)


def distance(covariance: Array) -> float:
    """Mean distance from the mean of a normal distribution with this covariance, (d, d)."""
    size = len(covariance)
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(size))
    draws = np.random.default_rng(0).standard_normal((4000, size))
    return float(np.linalg.norm(draws @ root.T, axis=1).mean())


def interval(values: Sequence[float]) -> str:
    """The mean and its 95 % interval."""
    return f"{np.mean(values):.3f} ± {1.96 * np.std(values) / np.sqrt(len(values)):.3f}"


def estimates(env: EnvConfig, controller: Controller, episodes: int) -> list[str]:
    """What the controller leaves, and an estimate of what can be known from what it read: a row of the table."""
    driven = drive(env, controller, episodes)
    config, truth, sds = driven.config, driven.hidden.vectors(), spreads(driven.config)
    _, _, tips = follow(config, driven.hidden, driven.motors)
    usable = np.flatnonzero(np.abs(tips - driven.tips).max(axis=(1, 2)) < SAME)
    exact = sds.copy()
    exact[: driven.hidden.surfaces[0].size] = 0.0
    found = []
    for known in (sds, exact):
        found.append(interval([expected_error(config, truth[k], driven.motors[k], known) for k in usable]))
    return [f"{driven.errors[usable].mean():.3f}", *found, f"{len(usable)} of {episodes}"]


def best(env: EnvConfig) -> dict[str, Controller]:
    """The smoother, and the policies that ship for a world, by name."""
    policies = {each.name: each for each in shipped_policies() if each.environment.id == env.id}
    return {"smoother": tuned_controllers(env.id)["smoother"]} | policies


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row per world and controller."""
    worlds = [*POLICIES, *ARMS, *CHAINS]
    parser = argparse.ArgumentParser(description="How well the tip can be known where nobody sees it.")
    parser.add_argument("--episodes", type=int, default=300)
    parser.add_argument("--worlds", nargs="+", choices=worlds, default=[*POLICIES, "ArmInstrument"])
    arguments = parser.parse_args(argv)
    rows = []
    for world in (each for each in arguments.worlds if each in POLICIES):
        env = EnvConfig(f"rj_gym/{world}-v0")
        policy = POLICIES[world]
        drivers = {"probing bank": tuned_controllers(env.id)["probing bank"], policy: load_policy(policy, version=0)}
        rows += [[world, name, *estimates(env, each, arguments.episodes)] for name, each in drivers.items()]
    heads = ("world", "driven by", "its error [mm]", "can be known [mm]", "surfaces known [mm]", "episodes")
    if rows:
        print(markdown_table(heads, rows))
    rows = []
    for world in (each for each in arguments.worlds if each in CHAINS):
        env = EnvConfig(CHAINS[world])
        rows += [[world, name, *chain_estimates(env, each, arguments.episodes)] for name, each in best(env).items()]
    if rows:
        print(markdown_table((*heads[:-1], "mean tension [N]", heads[-1]), rows))
    for world in ARMS.keys() & set(arguments.worlds):
        env = EnvConfig(ARMS[world])
        drivers: dict[str, Any] = {name: tuned_controllers(env.id)[name] for name in ARM_DRIVERS}
        drivers |= {each.name: each for each in shipped_policies() if each.environment.id == env.id}
        rows = [[name, *arm_estimates(env, each, arguments.episodes)] for name, each in drivers.items()]
        known = "can be known [mm]", "offsets known [mm]", "beads known [mm]"
        print(markdown_table((f"{world}, driven by", "its error [mm]", *known, "episodes"), rows))


if __name__ == "__main__":
    main()
