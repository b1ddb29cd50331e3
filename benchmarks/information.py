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
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from agents.controllers.controller import Controller
from agents.controllers.tuned import tuned_controllers
from agents.runs.environment import EnvConfig, make_vector_env
from agents.shipped import load_policy
from rj_gym.tracking.config import TrackingConfig
from rollingjoint import WorldForce, five_link, solve_lengths_batch, solve_tensions_batch
from rollingjoint.chain.variations import ChainVariations
from rollingjoint.load import load_table
from rollingjoint.tables import markdown_table
from rollingjoint.transmission import play_step, sheath_direction, sheath_ratio

Array = NDArray[np.float64]

POLICIES = {"Instrument": "instrument", "InstrumentShift": "instrument_shift"}  # that ship, by world

FIRST_SEED = 5_500_000  # of episodes that nothing was tuned or chosen on
ENCODER_SD = 1e-3  # mm: of motor positions, which are measured exactly
REACH = 1e-3  # standard deviations: of the central differences
SAME = 1e-6  # mm: by how much the model may miss the environment's tips
_DRAWS = np.random.default_rng(0).standard_normal((4000, 2))


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


def drive(env: EnvConfig, controller: Controller, episodes: int) -> Driven:
    """Episodes of these seeds under the controller."""
    envs = make_vector_env(env, episodes)
    envs.autoreset_mode = AutoresetMode.DISABLED
    observation, info = envs.reset(seed=list(range(FIRST_SEED, FIRST_SEED + episodes)))
    drawn, nominal = info["sampled"], five_link()
    hidden = Hidden(
        drawn.get("surface_offsets", np.zeros((episodes, 5, 2, 3))), drawn["forces"][:, 0], drawn["actuator_offsets"],
        drawn["stiffnesses"] / nominal.stiffnesses, drawn["play_mm"], drawn["sheath_friction"],
        drawn["motor_starts"] / drawn["play_mm"],
    )  # fmt: skip
    controller.begin(envs.task, episodes)
    tangents = [envs.tangent()]
    for _ in range(envs.task.config.episode_steps):
        observation, _, _, _, info = envs.step(controller.act(observation))
        tangents.append(envs.tangent())
    envs.close()
    motors, tips = (np.stack([getattr(each, name) for each in tangents], axis=1) for name in ("motors", "tips"))
    return Driven(envs.task.config, hidden, motors, tips, info["error_mm"])


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
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(2))
    return float(np.linalg.norm(_DRAWS @ root.T, axis=1).mean())


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
        errors = np.array([expected_error(config, truth[k], driven.motors[k], known) for k in usable])
        found.append(f"{errors.mean():.3f} ± {1.96 * errors.std() / np.sqrt(len(errors)):.3f}")
    return [f"{driven.errors[usable].mean():.3f}", *found, f"{len(usable)} of {episodes}"]


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row per world and controller."""
    parser = argparse.ArgumentParser(description="How well the tip can be known where nobody sees it.")
    parser.add_argument("--episodes", type=int, default=300)
    parser.add_argument("--worlds", nargs="+", choices=POLICIES, default=list(POLICIES))
    arguments = parser.parse_args(argv)
    rows = []
    for world in arguments.worlds:
        env = EnvConfig(f"rj_gym/{world}-v0")
        policy = POLICIES[world]
        drivers = {"probing bank": tuned_controllers(env.id)["probing bank"], policy: load_policy(policy)}
        rows += [[world, name, *estimates(env, each, arguments.episodes)] for name, each in drivers.items()]
    heads = ("world", "driven by", "its error [mm]", "can be known [mm]", "surfaces known [mm]", "episodes")
    print(markdown_table(heads, rows))


if __name__ == "__main__":
    main()
