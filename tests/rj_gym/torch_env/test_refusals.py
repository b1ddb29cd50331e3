"""What the environments of tensors do not support they refuse when they are made, new settings and weights included."""

from dataclasses import dataclass, fields, make_dataclass

import pytest

import rj_gym
from rj_gym import Terms
from rj_gym.core.settings import Settings
from rj_gym.tracking.config import LoadConfig, RewardConfig, TrackingConfig
from rollingjoint import InvalidInput, five_link
from rollingjoint.friction import CapstanFriction

torch = pytest.importorskip("torch")

from rj_gym.torch_env import TorchTrackingEnv  # noqa: E402 - needs torch
from rj_gym.torch_env.refusals import TAKEN  # noqa: E402
from tests.rj_gym.torch_env.test_torch_env import GOAL, INSTRUMENTS, SHORT, WORLDS  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_torch_thread")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"friction": {"mu": 0.1}},
            "friction = .*: expected None, and a mechanism without friction. gymnasium.make_vec",
        ),
        ({"mechanism": five_link().replace(friction=CapstanFriction(0.1))}, "friction = .*gymnasium.make_vec"),
        ({"env_id": "rj_gym/Instrument-v0", "friction": {"mu": 0.1}}, "friction = .*gymnasium.make_vec"),
        ({"env_id": GOAL, "sensing": {"delay": 2}}, "sensing, actuation, .*use the id without Goal"),
        (
            {"env_id": "rj_gym/FlexibleArm-v0"},
            "env_id = .*: expected one of rj_gym/RollingJoint-v0.*gymnasium.make_vec",
        ),
        ({"env_id": "rj_gym/ArmInstrument-v0"}, "env_id = .*rj_gym/Instrument-v0.*gymnasium.make_vec"),
        ({"device": "mps"}, 'device = \'mps\': expected a torch device, "cpu" or "cuda". Numbers have 64 bits.'),
        ({"device": "moon"}, "device = 'moon': expected a torch device"),
        ({"device": "cuda:99"}, "device = 'cuda:99': expected .*CUDA devices found: "),
        ({"num_envs": 0}, "num_envs = 0"),
        ({"autoreset_mode": "Sometimes"}, "autoreset_mode = 'Sometimes'"),
    ],
)
def test_what_is_not_supported_is_refused_in_one_line(settings, message):
    with pytest.raises(InvalidInput, match=message) as error:
        TorchTrackingEnv(**settings)
    assert "\n" not in str(error.value)


@dataclass(frozen=True)
class Overloaded(RewardConfig):
    """A reward with a weight that only another environment has."""

    overload: float = 0.0


@dataclass(frozen=True)
class Gusty(LoadConfig):
    """A load with a setting that only another environment has."""

    gusts: tuple[float, float] = (0.0, 0.0)


Gripping = make_dataclass("Gripping", [("grip", str, "none")], bases=(TrackingConfig,), frozen=True)
GrippingWorld = make_dataclass("GrippingWorld", [("grip", str, "firm")], bases=(Gripping,), frozen=True)
Costly = make_dataclass("Costly", [("overload", float, 0.1)], bases=(RewardConfig,), frozen=True)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"reward": Overloaded(overload=0.1)}, "reward.overload = 0.1: expected 0.0, since lanes on a device"),
        ({"reward": Costly()}, "reward.overload = 0.1: expected 0.0, since"),
        ({"load": Gusty(gusts=(0.0, 2.0))}, r"load.gusts = \(0.0, 2.0\): expected \(0.0, 0.0\), since"),
        ({"config": Gripping(grip="firm")}, "grip = 'firm': expected 'none', since"),
        ({"config": GrippingWorld()}, "grip = 'firm': expected 'none', since"),
    ],
)
def test_a_weight_or_setting_that_is_not_known_is_refused_in_one_line(settings, message):
    with pytest.raises(InvalidInput, match=f"{message}.*gymnasium.make_vec") as error:
        TorchTrackingEnv(**settings)
    assert "\n" not in str(error.value)


def test_a_weight_or_setting_that_is_not_known_is_left_out_where_it_is_off():
    TorchTrackingEnv(config=Gripping(reward=Overloaded(), load=Gusty()))


def settings_by_section(config=None):
    """All settings of a task, and their values, by the names of their sections."""
    config = TrackingConfig() if config is None else config
    whole = {each.name: getattr(config, each.name) for each in fields(config)}
    sections = {name: value for name, value in whole.items() if isinstance(value, Settings) and name != "friction"}
    plain = {name: value for name, value in whole.items() if name not in sections}
    return {"": plain} | {
        name: {each.name: getattr(value, each.name) for each in fields(value)} for name, value in sections.items()
    }


def test_every_setting_is_taken_or_known_to_be_refused():
    refused = {("", "friction"), *(("terms", each.name) for each in fields(Terms))}
    taken = {(section, name) for section, names in TAKEN.items() for name in names}
    every = {(section, name) for section, names in settings_by_section().items() for name in names}
    assert taken == every - refused and refused <= every, (
        "A setting is either in TAKEN and another value of it in a world of test_torch_env.py, or in `refused` here."
    )


def test_every_setting_that_is_taken_is_compared_with_the_native_environment_at_another_value():
    plain, compared = settings_by_section(), set()
    for env_id, world in (WORLDS | INSTRUMENTS).values():
        settings = SHORT | {name: value for name, value in world.items() if name != "autoreset_mode"}
        there = settings_by_section(rj_gym.settings_of(env_id).from_dict(settings))
        compared |= {
            (section, name)
            for section, values in there.items()
            for name, value in values.items()
            if value != plain[section][name]
        }
    assert {(section, name) for section, names in TAKEN.items() for name in names} - compared == set()


def test_a_mechanism_with_springs_is_refused_when_it_is_made_and_when_it_is_held():
    from rollingjoint import Spring

    springy = five_link().replace(springs=(Spring(1, 0.02, (30.0, 50.0)),))
    with pytest.raises(InvalidInput, match=r"springs of mechanism = .*: expected none"):
        TorchTrackingEnv(mechanism=springy)
    env = TorchTrackingEnv()
    with pytest.raises(InvalidInput, match=r"springs of options\['mechanism'\] = .*: expected none"):
        env.reset(seed=0, options={"mechanism": springy})
