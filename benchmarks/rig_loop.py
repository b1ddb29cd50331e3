"""A shipped policy through the manufacturer's SDK and a simulated bus, beside the simulated environment; and the loop.

    python benchmarks/rig_loop.py                   # episodes on the virtual clock
    python benchmarks/rig_loop.py --wall --rate 20  # the loop in real time, the simulated servos in the same process

Tip errors are means over the last 10 steps. In both worlds an episode has the play, sheath friction, stiffness,
surfaces, offsets, load, limits of tension and target that the simulation drew for its seed. Over the bus the start is a
homing by tension, motors have dynamics and a limit of current, and sensor noise is drawn anew.
"""

from __future__ import annotations

import argparse

import gymnasium
import numpy as np

from agents.policies.loading import load_policy
from agents.rig.cells import SerialCells
from agents.rig.dynamixel import Dynamixels, DynamixelSettings
from agents.rig.env import RigEnv
from agents.rig.guard import GuardSettings
from agents.rig.loop import Rig
from agents.rig.pace import LoopClock, VirtualClock, WallClock
from agents.rig.protocols import RigError
from agents.rig.simulated.bus import SimulatedBus
from agents.rig.simulated.plant import Plant
from agents.rig.simulated.servo import AMPERE_PER_COUNT, NEWTON_METRE_PER_AMPERE, At
from agents.rig.spool import Spools
from rollingjoint import WorldForce

FIRST_SEED = 21_000_000
OPEN = GuardSettings(low=0.01, high=98.0, stop=99.0)  # limits are those of the motors


def main() -> None:
    """Print errors of both worlds, or the loop's times."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--policy", default="instrument", help="name of a shipped policy of Instrument-v1")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--rate", type=float, default=20.0, help="steps per second")
    parser.add_argument("--looks", type=int, default=4, help="of the guard in a step")
    parser.add_argument("--wall", action="store_true", help="in real time")
    arguments = parser.parse_args()
    policy = load_policy(arguments.policy, version=1)
    env = gymnasium.make(policy.env_id, config=policy.settings).unwrapped
    simulated, on_bus = [], []
    for seed in range(FIRST_SEED, FIRST_SEED + arguments.episodes):
        observation, info = env.reset(seed=seed)
        sampled, target = info["sampled"], info["target"]
        plant, limits = plant_of(env, info, seed), sampled["tension_limits"]
        policy.reset()
        errors = []
        for _ in range(policy.settings.episode_steps):
            observation, _, _, _, info = env.step(policy(observation))
            errors.append(info["error_mm"])
        simulated.append(np.mean(errors[-10:]))
        errors, _ = over_the_bus(policy, plant, limits, target, VirtualClock(), arguments)  # compiles what is needed
        if arguments.wall:
            env.reset(seed=seed)
            try:
                fresh = plant_of(env, {"sampled": sampled}, seed)
                errors, summary = over_the_bus(policy, fresh, limits, target, WallClock(), arguments)
                print(summary)
            except RigError as error:
                print(f"seed {seed}: {error}")
                simulated.pop()
                continue
        on_bus.append(np.mean(errors[-10:]))
    first, second = np.array(simulated), np.array(on_bus)
    apart = (second - first).std(ddof=1) / np.sqrt(len(first)) if len(first) > 1 else np.nan
    print(f"{len(first)} episodes, {arguments.rate:g} Hz:", end=" ")
    print(f"simulated {first.mean():.3f} mm (median {np.median(first):.3f}),")
    print(f"over the bus {second.mean():.3f} mm (median {np.median(second):.3f}); bus minus simulated", end=" ")
    print(f"{(second - first).mean():+.3f} mm, standard error {apart:.3f}")


def plant_of(env, info, seed: int) -> Plant:
    """The plant that an episode of the simulation has."""
    sampled, buffer = info["sampled"], env._buffer
    chain = buffer.solver.mechanisms[buffer.solver.designs[0]]
    load = WorldForce(int(sampled["link"]), tuple(sampled["forces"][0]))
    return Plant(chain, sampled["play_mm"], sampled["sheath_friction"], sampled["actuator_offsets"], [load], seed=seed)


def over_the_bus(policy, plant: Plant, limits, target, clock: LoopClock, arguments) -> tuple[list[float], str]:
    """Tip errors of an episode over a simulated bus [mm], and the times of its loop."""
    bus = SimulatedBus(plant, clock, signs=(1, -1))
    for servo, limit in zip(bus.servos.values(), limits, strict=True):
        counts = round(limit * 1e-3 * bus.radius_mm / NEWTON_METRE_PER_AMPERE / AMPERE_PER_COUNT)
        servo.put(At.CURRENT_LIMIT, 2, max(1, counts))  # as it was configured
    spools = Spools(bus.radius_mm, (1, -1), tuple(round(s.position) for s in bus.servos.values()), tuple(plant.q))
    patience = 2000.0 if isinstance(clock, VirtualClock) else 10.0
    try:
        motors = Dynamixels(DynamixelSettings(bus.port, (1, 2)), spools, clock, 1.0 / arguments.rate, patience)
        if isinstance(clock, VirtualClock):
            clock.quiet.append(lambda: bus.received >= motors.port.sent)
        motors.connect()
        cells = SerialCells(bus.cell_port, 2, clock, timeout=max(0.02, 1e-3 * patience))
        with Rig(motors, cells, clock, plant.q.copy(), OPEN, arguments.rate, arguments.looks) as rig:
            env = RigEnv(policy.settings, rig)
            observation, _ = env.reset(options={"target": target})
            policy.reset()
            rig.pace.late.clear()
            rig.pace.work.clear()
            errors = []
            for _ in range(policy.settings.episode_steps):
                observation, *_ = env.step(policy(observation))
                with bus.lock:
                    errors.append(float(np.linalg.norm(plant.tip - target)))
            return errors, rig.pace.summary()
    finally:
        bus.close()


if __name__ == "__main__":
    main()
