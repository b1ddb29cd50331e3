"""Robots that nobody modelled: what they are, how they are driven, the command, and docs/robots.md."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from stable_baselines3 import PPO

import rj_gym
from agents import adapt
from agents.adaptation import driving, trial
from agents.adaptation.controllers import InstrumentController, instrument_controller, instrument_controllers, marked
from agents.adaptation.driving import RobotScore, seeds_of
from agents.adaptation.identify import Identified, Space
from agents.adaptation.trial import RobotTrial, TrialOutcome
from agents.controllers import OpenLoop
from agents.policies.export import export_policy
from agents.robots import DEVELOPMENT, TEST_BED, robot, robots, score_on_robots
from agents.runs.environment import EnvConfig
from agents.runs.files import RunFolderError
from agents.runs.seeds import ROBOTS, TEST, TUNING, VALIDATION
from agents.studies import robots as study
from agents.studies.robots import score_table
from rj_gym.sb3 import make_sb3_env
from rollingjoint.chain.presets import five_link
from rollingjoint.errors import ConfigError, InvalidInput

TEXT = Path("docs/robots.md").read_text(encoding="utf-8")


def test_every_robot_is_outside_the_ranges_that_controllers_know_and_the_same_every_time():
    known = rj_gym.InstrumentConfig()
    rest = known.randomization
    for one in robots():
        assert (one.play_mm >= known.actuation.play_mm[1]).all()
        assert (one.sheath_friction >= known.actuation.sheath_friction[1]).all()
        assert known.friction is None and (one.mu > 0).all()
        assert (np.abs(one.stiffness - 1) >= rest.stiffness_spread).all()
        assert (np.abs(one.motor_offsets) >= rest.actuator_offset_mm).all()
        assert (np.abs(one.surface_errors[..., :2]) >= rest.link_tolerance_mm).all()
        assert (np.abs(one.surface_errors[..., 2]) >= rest.link_tolerance_rad).all()
    first = robot(0)
    np.testing.assert_allclose(first.play_mm, [3.764, 3.469], atol=5e-4)
    robot.cache_clear()
    assert robot(0) is not first and (robot(0).surface_errors == first.surface_errors).all()


def test_the_chain_of_a_robot_has_all_of_its_errors():
    for one in robots():
        for link, nominal, (parent, child) in zip(one.chain.links, five_link().links, one.surface_errors, strict=True):
            for made, ideal, error in ((link.parent, nominal.parent, parent), (link.child, nominal.child, child)):
                moved = [*np.subtract(made.start, ideal.start), made.angle - ideal.angle]
                np.testing.assert_allclose(moved, error, atol=1e-12)
        np.testing.assert_allclose(one.chain.stiffnesses, five_link().stiffnesses * one.stiffness)


def test_episodes_of_robots_have_seeds_of_their_own():
    ranges = [seeds_of(robot(number), driving.MOST_EPISODES) for number in (*TEST_BED, *DEVELOPMENT)]
    taken = [seed for each in ranges for seed in (each[0], each[-1])]
    assert len(set(taken)) == 200 and all(seed in ROBOTS for seed in taken)
    for other in (TEST, VALIDATION, TUNING):
        assert other.stop <= ROBOTS.start or other.start >= ROBOTS.stop


def test_robots_side_by_side_are_driven_as_each_alone_in_its_scalar_environment():
    together = score_on_robots(OpenLoop(13.8), robots(range(2)), episodes=2)
    alone = score_on_robots(OpenLoop(13.8), robots([1]), episodes=2)
    np.testing.assert_array_equal(together.errors[1], alone.errors[0])
    env = rj_gym.InstrumentEnv(friction={"mu": 0.0, "shared": False})
    one = robot(1)
    _, info = env.reset(seed=seeds_of(one, 2)[1], options=one.options)
    drawn = info["sampled"]
    for name, expected in {
        "play_mm": one.play_mm,
        "sheath_friction": one.sheath_friction,
        "friction_mu": one.mu,
        "actuator_offsets": one.motor_offsets,
        "stiffnesses": one.chain.stiffnesses,
    }.items():
        np.testing.assert_allclose(drawn[name], expected)
    assert (np.abs(drawn["motor_starts"]) <= one.play_mm / 2).all()
    errors = [env.step([0.0, 0.0])[-1]["error_mm"] for _ in range(50)]
    still = score_on_robots(Still(), [one], episodes=2)
    assert still.errors[0, 1] == np.mean(errors[-10:])


def test_controllers_are_told_of_the_nominal_mechanism_and_the_known_ranges():
    told = Still()
    score_on_robots(told, robots(range(1)), episodes=1)
    assert told.task.mechanism is not robot(0).chain
    assert (told.task.mechanism.stiffnesses == five_link().stiffnesses).all()
    assert told.task.config.actuation == rj_gym.InstrumentConfig().actuation
    assert told.task.config.friction.mu == (0.0, 0.0)


def test_a_score_is_the_mean_over_robots_with_an_interval_over_them():
    errors = np.array([[1.0, 3.0], [2.0, 2.0], [6.0, 10.0]])
    score = RobotScore(errors, known=errors / 2)
    np.testing.assert_array_equal(score.of_robots, [2, 2, 8])
    assert score.mean.value == 4 and score.mean.low == pytest.approx(2) and score.mean.high == pytest.approx(8)
    assert score.known_mean.value == 2
    better = RobotScore(errors - 0.5, known=errors)
    _, _, first, second = score_table({"one": score, "two": better}).splitlines()
    assert first.split()[:2] == ["two", "3.50"] and second.split()[:2] == ["one", "4.00"]
    assert re.split(r"  +", second)[2:5] == ["2.00", "2.00", "8.00"]


@pytest.mark.slow
def test_controllers_are_found_by_name_file_and_run(tmp_path):
    (tmp_path / "own.py").write_text("from agents.controllers import DoNothing\n")
    assert {"open loop", "probing bank", "privileged teacher"} <= instrument_controllers().keys()
    assert marked("x", instrument_controllers()["privileged teacher"]) == "x (privileged)"
    assert type(instrument_controller(f"{tmp_path}/own.py:DoNothing").controller).__name__ == "DoNothing"
    with pytest.raises(ConfigError, match="trained in rj_gym/RollingJoint-v0, with other observations"):
        instrument_controller("fixed_target")
    with pytest.raises(ConfigError, match="open loop"):
        instrument_controller("open lop")
    with pytest.raises(RunFolderError, match=r"config\.yaml"):
        instrument_controller(str(tmp_path))


def test_a_policy_file_drives_robots_with_the_lags_that_it_was_trained_with(tmp_path):
    settings = {"observe_history": [1, 3]}
    model = PPO("MlpPolicy", make_sb3_env(driving.WORLD, 1, **settings), seed=1, device="cpu", n_steps=8, batch_size=8)
    training = {"config": {}, "steps": 0, "seed": 1, "versions": {}}
    policy = export_policy(model, None, EnvConfig(driving.WORLD, settings=settings), "mine", training)
    (tmp_path / "mine.safetensors").write_bytes(policy.to_bytes())
    found = instrument_controller(str(tmp_path / "mine.safetensors"))
    assert found.settings == {"observe_history": (1, 3)}
    score = score_on_robots(found.controller, robots(range(2)), episodes=1, settings=found.settings)
    assert score.errors.shape == (2, 1) and score.mean.value > 0.5


def test_wrong_numbers_are_refused(capsys):
    for wrong in (["--robots", "0"], ["--robots", "51"], ["--episodes", "0"], ["--controller", "nobody"]):
        assert study.main(wrong) == 2
        assert "error:" in capsys.readouterr().err
    with pytest.raises(InvalidInput, match=">= 0"):
        robot(-1)
    with pytest.raises(InvalidInput, match=">= 0"):
        robot(-1, 1)
    with pytest.raises(InvalidInput, match="1 or more"):
        robots([])


@pytest.mark.slow
def test_every_command_of_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(study, "score_on_robots", quick)
    monkeypatch.setattr(trial, "adaptable", lambda name: InstrumentController(None))
    monkeypatch.setattr(trial, "tried", adapted_at_once)
    own = re.search(r"^```python\n(from agents.controllers import OpenLoop.*?)^```", TEXT, flags=re.M | re.S)
    (tmp_path / "my_controller.py").write_text(own[1])
    monkeypatch.chdir(tmp_path)
    commands = "".join(re.findall(r"^```bash\n(.*?)^```", TEXT, flags=re.M | re.S)).splitlines()
    assert commands
    for command in commands:
        rj, name, *arguments = shlex.split(command)
        assert rj == "rj"
        assert {"robots": study, "adapt": adapt}[name].main(arguments) == 0
    assert "probing bank" in capsys.readouterr().out


def quick(controller, driven, episodes, settings, known):
    """A score in place of driving."""
    return RobotScore(np.ones((len(driven), episodes)), np.ones((len(driven), episodes)) if known else None)


def adapted_at_once(one, chosen, plan, say):
    """A trial in place of identification, adaptation and driving."""
    space = Space()
    found = Identified(one.number, space.mean, np.diag(space.sd), 1.0, 2.0)
    made = {name: TrialOutcome(np.full(2, 3.0), np.full(2, 1.0), 1.0, each) for name, each in chosen.items()}
    return RobotTrial(one, found, 1.0, made)


class Still:
    """Does nothing, and keeps what it is told."""

    def begin(self, task, episodes):
        self.task, self.episodes = task, episodes

    def act(self, seen):
        return np.zeros((self.episodes, 2))


def test_generation_1_has_the_same_robots_with_limits_outside_the_ranges_of_every_version():
    from agents.adaptation.robot import TENSION_LIMIT
    from rj_gym import InstrumentV1Config

    assert InstrumentV1Config().actuation.tension_limit[1] <= TENSION_LIMIT[0]
    for number in (0, 7):
        first, second = robot(number), robot(number, generation=1)
        assert first.tension_limits is None and "tension_limit" not in first.options
        limits = second.options.pop("tension_limit")
        assert np.all(limits > TENSION_LIMIT[0]) and np.all(limits < TENSION_LIMIT[1]) and np.ptp(limits) > 0
        assert np.array_equal(first.play_mm, second.play_mm) and np.array_equal(first.mu, second.mu)


def test_controllers_drive_generation_1_and_its_limits_are_listed(capsys):
    assert study.main(["--list", "--robots", "1", "--generation", "1"]) == 0
    assert "limits [N]" in capsys.readouterr().out
    command = ["--robots", "2", "--episodes", "1", "--generation", "1", "--controller", "instrument"]
    assert study.main(command) == 0
    assert "with the motors of version 1" in capsys.readouterr().out
