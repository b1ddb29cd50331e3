"""RigEnv: the observations of the simulation, shipped policies over the bus, and resets by tension."""

import json

import gymnasium
import numpy as np
import pytest

from agents.policies.loading import load_policy
from agents.rig.env import RigEnv
from agents.rig.simulated.plant import Plant
from rj_gym.tracking.arrays import POSITION, TENSION
from rj_gym.tracking.worlds import InstrumentV1Config, LatePoseConfig
from rollingjoint import WorldForce, five_link
from rollingjoint.errors import InvalidInput
from rollingjoint.identify import RecordingWriter

from .rigs import GUARD, built

pytestmark = pytest.mark.posix


@pytest.mark.parametrize("version", [0, 1])
def test_observations_of_measurements_of_the_simulation_are_those_of_the_simulation_to_the_last_bit(version):
    policy = load_policy("instrument", version=version)
    simulated = gymnasium.make(policy.env_id, **{"config": policy.settings}).unwrapped
    with built(patience_ms=3000.0) as one:
        env = RigEnv(policy.settings, one.rig())
        for seed in range(3):
            observation, info = simulated.reset(seed=seed)
            env.reset(seed=seed, options={"target": info["target"]})
            policy.reset()
            for step in range(51):
                measured = simulated._buffer.hardware.measured[0]
                env._step = step
                env.enter(measured[POSITION].copy(), measured[TENSION].copy())
                np.testing.assert_array_equal(env._buffer.observe()[0], observation)
                action = policy(observation)
                actions = env._buffer.state.actions[0]
                actions[1], actions[0] = actions[0].copy(), np.clip(action, -1.0, 1.0)
                if step < 50:
                    observation = simulated.step(action)[0]
        env.close()
    simulated.close()


def test_spaces_are_those_of_the_task_and_a_task_with_poses_is_refused():
    with built(patience_ms=3000.0) as one:
        rig = one.rig()
        env = RigEnv(InstrumentV1Config(), rig)
        simulated = gymnasium.make("rj_gym/Instrument-v1")
        assert env.observation_space == simulated.observation_space and env.action_space == simulated.action_space
        with pytest.raises(InvalidInput, match=r"sensing\.pose"):
            RigEnv(LatePoseConfig(), rig)
        with pytest.raises(InvalidInput, match="target"):
            env.reset(options={"load": 1})
        env.reset(seed=1)
        with pytest.raises(InvalidInput, match="Motors hold"):
            env.step(np.array([np.nan, 0.0]))
        rig.close()


def test_a_reset_ends_at_the_tension_of_the_start():
    with built(plant=Plant(five_link(), play=2.0, sheath=0.5, start_tension=6.0), patience_ms=3000.0) as one:
        env = RigEnv(InstrumentV1Config(), one.rig())
        _, info = env.reset(seed=1)
        np.testing.assert_allclose(info["tensions"], InstrumentV1Config().start_tension, atol=0.5)
        env.close()


def driven(policy, seed, over_the_bus):
    """Mean tip error over the last 10 steps of an episode of the policy's world, simulated or over the bus [mm]."""
    simulated = gymnasium.make(policy.env_id, **{"config": policy.settings}).unwrapped
    observation, info = simulated.reset(seed=seed)
    sampled, target = info["sampled"], info["target"]
    policy.reset()
    errors = []
    if not over_the_bus:
        for _ in range(policy.settings.episode_steps):
            observation, _, _, _, info = simulated.step(policy(observation))
            errors.append(info["error_mm"])
        return float(np.mean(errors[-10:]))
    chain = simulated._buffer.solver.mechanisms[0]
    load = WorldForce(int(sampled["link"]), tuple(sampled["forces"][0]))
    plant = Plant(chain, sampled["play_mm"], sampled["sheath_friction"], sampled["actuator_offsets"], [load], seed=seed)
    limit = float(np.mean(sampled["tension_limits"]))
    with built(plant=plant, current_limit=limit, patience_ms=3000.0) as one:
        env = RigEnv(policy.settings, one.rig(guard=GUARD_OF_MOTORS))
        observation, _ = env.reset(seed=seed, options={"target": target})
        for _ in range(policy.settings.episode_steps):
            observation, *_ = env.step(policy(observation))
            errors.append(float(np.linalg.norm(one.plant.tip - target)))
        env.close()
    return float(np.mean(errors[-10:]))


GUARD_OF_MOTORS = type(GUARD)(low=0.01, high=98.0, stop=99.0)


@pytest.mark.slow
def test_a_shipped_policy_ends_over_the_bus_about_where_it_ends_in_simulation():
    policy = load_policy("instrument", version=1)
    errors = np.array([[driven(policy, seed, over) for over in (False, True)] for seed in range(500, 508)])
    simulated, bus = errors.mean(axis=0)
    assert simulated < 2.5 and abs(bus - simulated) < 1.0, errors


def test_a_recording_says_how_late_steps_were(tmp_path):
    with built() as one, RecordingWriter(tmp_path / "late.jsonl") as writer:
        rig, read = one.rig(writer=writer), one.motors.read

        def slow():
            one.clock.sleep_until(one.clock.now() + 0.02)  # of 0.0125 s for a look
            return read()

        rig.begin("1")
        rig.step(rig.goal)
        one.motors.read = slow
        assert rig.step(rig.goal).late == pytest.approx(0.0075)
    lines = (tmp_path / "late.jsonl").read_text().splitlines()
    assert [json.loads(line)["late"] for line in lines[1:]] == pytest.approx([0.0, 0.0, 0.0075])
