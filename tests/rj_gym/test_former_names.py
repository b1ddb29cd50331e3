"""Pickles, and programs, that name classes where they were until version 0.1.0."""

import gzip
import importlib
import pickle
from pathlib import Path

import pytest

import rj_gym
from rollingjoint.errors import InvalidInput

# Of revision 59c9966, before the settings of motors: gzip.compress(pickle.dumps(environments, protocol=4)), by name
# pickle.dumps(env.unwrapped, protocol=4) after reset(seed=0), episode_steps=2: rj_gym/Instrument-v0 with uniform(2),
# and two lanes of rj_gym/ArmInstrument-v0 with small_arm(2).
ENVIRONMENTS = Path(__file__).parent / "former_environments.gz"
FORMER = {
    "rj_gym.planar.config": ["TrackingConfig", "LoadConfig", "RandomizationConfig"],
    "rj_gym.planar.worlds": ["InstrumentConfig", "InstrumentShiftConfig", "SlowCameraConfig", "LatePoseConfig"],
    "rj_gym.planar.env": ["RollingJointEnv", "RollingJointGoalEnv", "InstrumentEnv"],
    "rj_gym.planar.vector": ["RollingJointVectorEnv", "RollingJointGoalVectorEnv", "SlowCameraVectorEnv"],
    "rj_gym.planar.observation": ["observation_entries"],
    "rj_gym.arm.config": ["FlexibleArmConfig", "PayloadConfig", "ArmTargetConfig", "ArmRewardConfig", "GravityConfig"],
    "rj_gym.arm.worlds": ["ArmInstrumentConfig"],
    "rj_gym.arm.env": ["FlexibleArmEnv", "FlexibleArmGoalEnv", "ArmInstrumentEnv"],
    "rj_gym.arm.vector": ["FlexibleArmVectorEnv", "ArmInstrumentVectorEnv"],
    "rj_gym.core.config": ["RewardConfig", "TargetConfig", "FrictionConfig", "TaskConfig"],
    "rj_gym.core.sensing": ["SensingConfig", "ActuationConfig"],
    "rj_gym.core.registry": ["settings_of"],
}


@pytest.mark.parametrize("module", FORMER)
def test_former_names_are_those_of_today(module):
    for name in FORMER[module]:
        found = pickle.loads(f"c{module}\n{name}\n.".encode())
        assert found is getattr(rj_gym, name) is getattr(importlib.import_module(module), name)


def test_former_classes_of_tasks_and_tangents_are_found():
    for module, name in (("planar.task", "PlanarTask"), ("arm.task", "ArmTask"), ("core.tangent", "Tangent")):
        assert pickle.loads(f"crj_gym.{module}\n{name}\n.".encode()).__name__ == name
    assert pickle.loads(b"crj_gym.core.tracking_task\nTrackingTask\n.").__name__ == "TrackingTask"


def test_a_pickle_of_a_whole_environment_of_an_earlier_version_says_how_to_go_on():
    with pytest.raises(InvalidInput, match=r"pickle of an environment.*anew"):
        pickle.loads(b"crj_gym.planar.episodes\nPlanarEpisodeBuffer\n)\x81.")


@pytest.mark.parametrize("name", ["Instrument", "ArmInstrument lanes"])
def test_environments_from_before_the_settings_of_motors_say_in_one_line_how_to_go_on(name):
    pickled = pickle.loads(gzip.decompress(ENVIRONMENTS.read_bytes()))[name]
    with pytest.raises(InvalidInput, match=r"pickle of an environment.*anew") as refused:
        pickle.loads(pickled)
    assert "\n" not in str(refused.value)
