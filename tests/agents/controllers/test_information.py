"""How well the tip can be known: the model is the environment's, and what is not measured is as uncertain as it is."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.controllers.tuned import tuned_controllers
from agents.runs.environment import EnvConfig
from rollingjoint.estimate.arm_rows import tip_covariance

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
ENV = EnvConfig("rj_gym/Instrument-v0")


@pytest.fixture(scope="module")
def information() -> Any:
    sys.path.insert(0, str(BENCHMARKS))
    import information

    sys.path.remove(str(BENCHMARKS))
    return information


@pytest.fixture(scope="module")
def driven(information: Any) -> Any:
    return information.drive(ENV, tuned_controllers(ENV.id)["open loop"], 12)


def test_the_model_follows_the_environment(information: Any, driven: Any) -> None:
    begin, _, tips = information.follow(driven.config, driven.hidden, driven.motors)
    np.testing.assert_allclose(begin, driven.motors[:, 0], atol=1e-12)
    same = np.abs(tips - driven.tips).max(axis=(1, 2)) < information.SAME
    assert same.sum() >= 6, "most episodes keep away from tension limits"


def test_without_tensions_a_load_leaves_what_it_moves(information: Any, driven: Any) -> None:
    """The closed form, beside tips under drawn loads."""
    unread = replace(driven.config, sensing=replace(driven.config.sensing, tension_noise=100.0))
    truth, motors = driven.hidden.vectors()[0], driven.motors[0]
    sds, force = np.zeros(truth.size), slice(30, 32)
    sds[force] = 0.01
    rows = np.tile(truth, (2000, 1))
    rows[:, force] += sds[force] * np.random.default_rng(1).standard_normal((2000, 2))
    _, _, tips = information.follow(unread, information.Hidden.of(rows), np.tile(motors, (2000, 1, 1)))
    around = np.linalg.norm(tips[:, -1] - tips[:, -1].mean(axis=0), axis=1).mean()
    assert information.expected_error(unread, truth, motors, sds) == pytest.approx(around, rel=0.05)


def test_the_more_is_known_the_nearer(information: Any, driven: Any) -> None:
    config, truth, motors = driven.config, driven.hidden.vectors()[0], driven.motors[0]
    sds = information.spreads(config)
    exact = np.where(np.arange(sds.size) < 30, 0.0, sds)
    loud = replace(config, sensing=replace(config.sensing, tension_noise=1.0))
    limit = information.expected_error(config, truth, motors, sds)
    assert information.expected_error(config, truth, motors, exact) < 0.9 * limit
    assert information.expected_error(loud, truth, motors, sds) > 1.1 * limit


def known(information: Any, watched: Any, **options: Any) -> Any:
    """What can be known of every episode's tip [mm]."""
    prior, track = information.follow_chain(watched, **options)
    return [information.distance(each) for each in tip_covariance(track.information, track.tip_by, prior.sds)]


def test_the_smoother_s_derivatives_tell_what_central_differences_tell(information: Any) -> None:
    env = EnvConfig("rj_gym/InstrumentShift-v0")
    controller = tuned_controllers(env.id)["open loop"]
    driven, watched = information.drive(env, controller, 12), information.watch(env, controller, 12)
    same = np.flatnonzero((watched.shifts == 0.0).all(axis=(1, 2)))[
        :3
    ]  # else differences lie across a limit of tension
    truth, sds = driven.hidden.vectors(), information.spreads(driven.config)
    expected = [information.expected_error(driven.config, truth[k], driven.motors[k], sds) for k in same]
    found = known(information, watched, last=True, limit_sd=0.0)
    np.testing.assert_allclose([found[k] for k in same], expected, rtol=1e-4)


@pytest.mark.parametrize("world", ["InstrumentShift-v1", "SlowCamera-v0", "LatePose-v1"])
def test_chains_of_every_kind_are_followed_to_where_their_tips_are(information: Any, world: str) -> None:
    env = EnvConfig(f"rj_gym/{world}")
    watched = information.watch(env, tuned_controllers(env.id)["open loop"], 12)
    _, track = information.follow_chain(watched)
    misses = np.linalg.norm(track.tip - watched.tips[:, -1], axis=1)
    assert misses.max() < (information.SAME_CHAIN if world == "SlowCamera-v0" else 1e-6)
    before, after = (np.mean(known(information, watched, last=last)) for last in (False, True))
    assert after < before
    if "Instrument" not in world:
        blind = watched._replace(ages=np.full_like(watched.ages, np.nan))
        assert np.mean(known(information, blind)) > 1.02 * before


def test_the_command_prints_a_row_per_controller(information: Any, capsys: pytest.CaptureFixture[str]) -> None:
    information.main(["--episodes", "4", "--worlds", "InstrumentShift"])
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[1] for row in rows[2:]] == ["probing bank", "instrument_shift"]


def test_worlds_with_the_motors_of_a_rig_have_rows_of_the_smoother_and_the_policy(
    information: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    information.main(["--episodes", "4", "--worlds", "SlowCamera-v1"])
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[1] for row in rows[2:]] == ["smoother", "slow_camera"]
