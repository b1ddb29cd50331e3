"""Settings of the environments: defaults, nesting, and complaints that carry a hint."""

import dataclasses

import pytest

from rj_gym import LoadConfig, TrackingConfig
from rollingjoint.chain.presets import five_link
from rollingjoint.errors import ConfigError


def test_defaults_are_the_documented_task():
    config = TrackingConfig()
    assert config.mechanism == "five_link"
    assert (config.episode_steps, config.action_scale_mm, config.tension_range) == (50, 1.0, (0.5, 15.0))
    assert (config.load.magnitude, config.load.link, config.load.process) == ((0.0, 1.0), "random", "constant")
    assert all(value == 0 for value in dataclasses.asdict(config.randomization).values())


def test_nested_dictionary_changes_only_what_it_names():
    base = TrackingConfig.from_dict({"episode_steps": 20, "load": {"link": "tip", "process": "ou"}})
    changed = base.updated({"load": {"magnitude": [0, 1.5]}})
    assert changed.load == LoadConfig(magnitude=(0.0, 1.5), link="tip", process="ou")
    assert changed.episode_steps == 20
    assert base.load.magnitude == (0.0, 1.0)


def test_constructor_takes_dictionaries_for_nested_settings():
    assert TrackingConfig(load={"link": "tip"}).load == LoadConfig(link="tip")


def test_mechanism_may_be_an_object():
    chain = five_link()
    assert TrackingConfig(mechanism=chain).mechanism is chain


def test_settings_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        TrackingConfig().episode_steps = 3


@pytest.mark.parametrize(
    ("values", "nearest"),
    [
        ({"episode_step": 3}, "episode_steps"),
        ({"load": {"magnitud": (0, 1)}}, "magnitude"),
        ({"reward": {"error_scale": 5}}, "error_scale_mm"),
        ({"load": {"process": "constan"}}, "constant"),
    ],
)
def test_unknown_names_are_refused_with_the_nearest_valid_one(values, nearest):
    with pytest.raises(ConfigError, match=f"Did you mean '{nearest}'"):
        TrackingConfig.from_dict(values)


@pytest.mark.parametrize(
    "values",
    [
        {"episode_steps": 0},
        {"episode_steps": 1.5},
        {"episode_steps": float("nan")},
        {"action_scale_mm": 0},
        {"action_scale_mm": "1e-3"},
        {"action_scale_mm": 10**400},
        {"action_scale_mm": 10**5000},
        {"tension_range": (15.0, 0.5)},
        {"tension_range": (1.0, 1.0)},
        {"tension_range": 3.0},
        {"start_tension": 20.0},
        {"start": "anything"},
        {"start_tension_range": (0.1, 3.0)},
        {"observe_tensions": 1},
        {"mechanism": 5},
        {"load": 3},
        {"load": {"magnitude": (-1, 1)}},
        {"load": {"magnitude": (0, float("inf"))}},
        {"load": {"hold_steps": 0.5}},
        {"load": {"link": "elbow"}},
        {"target": {"waypoints": 1}},
        {"target": {"tension_range": (0, 1)}},
        {"reward": {"effort": -1}},
        {"reward": {"goal": "other"}},
        {"randomization": {"stiffness_spread": 1.0}},
        {"randomization": {"link_tolerance_mm": True}},
    ],
)
def test_values_out_of_range_are_refused(values):
    with pytest.raises(ConfigError, match="expected"):
        TrackingConfig.from_dict(values)


def test_a_dictionary_is_needed():
    with pytest.raises(ConfigError, match="a dictionary"):
        TrackingConfig.from_dict([("episode_steps", 3)])
