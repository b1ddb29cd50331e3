"""Tasks of the results page: what makes two the same, what they are called, their worlds, who can drive in them."""

import io
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from agents.controllers import Controller, untuned_controllers
from agents.results import films, roster
from agents.results.description import _actuation, _sensing, description
from agents.results.environment import changed, episodes_key
from agents.results.record import SHIFT, SWEEP, TEST, VALIDATION
from agents.results.roster import opponents
from agents.results.runs import Benchmark, FinishedRun, Recipe, _title, _without_seed
from agents.results.worlds import AXES, NOTES, TASK_NOTES, ScoringPlan, task_note, worlds_of
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from rj_gym import InstrumentConfig, InstrumentV1Config
from rj_gym.tracking.config import FlexibleArmConfig, FrictionConfig, TrackingConfig
from rj_gym.tracking.sensing import ActuationConfig, SensingConfig


def test_what_a_learner_remembers_makes_no_other_task_but_what_is_measured_does():
    past = {"observe_history": [1, 4], "privileged": "observation", "reward": {"effort": 0.5}}
    quiet = {"sensing": {"tension_noise": 0.0}}
    envs = (EnvConfig("rj_gym/Instrument-v0", settings=settings) for settings in ({}, past, quiet))
    plain, with_past, without_noise = map(episodes_key, envs)
    assert plain == with_past != without_noise


@pytest.mark.parametrize(
    "name", ["ppo_late_pose", "her_late_pose", "recurrent_ppo_late_pose", "plain_ppo_late_pose", "apg_late_pose"]
)
def test_a_task_is_called_what_is_behind_its_algorithm(name):
    assert _title([Recipe(name, [])]) == "late pose"


def test_a_task_without_poses_is_described_and_has_curves_of_play_and_friction():
    env = EnvConfig("rj_gym/InstrumentShift-v0")
    text = description(env.arguments()["config"])
    assert "Every tendon has a play of 0.5 to 2 mm" in text and "Neither pose nor tip is measured." in text
    found = worlds_of(env, ScoringPlan(range(9_000_000, 9_000_004), range(2), 2))
    assert [world.name for world in found if world.role == SHIFT][:2] == [
        "More play than in training, 2 to 3 mm",
        "More sheath friction than in training, 0 to 0.6",
    ]
    axes = {world.axis for world in found if world.role == SWEEP}
    assert axes == {axis.label for axis in AXES if axis.name != "limit"}
    able, impossible = opponents(env)
    assert "open loop" in able and "jacobian feedback" in impossible


def test_worlds_with_the_motors_of_a_rig_have_a_curve_over_their_limit():
    found = worlds_of(EnvConfig("rj_gym/Instrument-v1"), ScoringPlan(range(9_000_000, 9_000_004), range(2), 2))
    limits = [world for world in found if world.axis == "limit of tension [N]"]
    assert [world.value for world in limits] == [10, 15, 20, 30, 45, 60] and limits[0].trained == (10, 30)
    assert "Stronger motors than in training, 30 to 45 N" in [world.name for world in found if world.role == SHIFT]


@pytest.mark.parametrize("world", ["Instrument", "InstrumentShift", "SlowCamera", "LatePose"])
def test_worlds_in_which_learning_is_needed_are_shown_with_capstan_friction_too(world):
    env = EnvConfig(f"rj_gym/{world}-v0")
    found = worlds_of(env, ScoringPlan(range(9_000_000, 9_000_004), range(2), 2))
    (shift,) = [one for one in found if one.role == SHIFT and "capstan" in one.heading]
    assert changed(env, shift.changes).arguments()["config"].friction == FrictionConfig()
    assert "No filter here has a state for that" in NOTES[shift.heading]
    curve = [one for one in found if one.axis == "coefficient of friction in the holes"]
    assert [one.value for one in curve] == [0, 0.025, 0.05, 0.075, 0.1, 0.125]
    assert {one.trained for one in curve} == {(0.0, 0.0)}


def test_a_task_is_described_by_its_settings():
    planar = description(TrackingConfig(load={"link": "tip", "process": "step"}, start="random"))
    assert "five_link (5 links, 2 tendons, 100 mm): the tip goes to a fixed target in 50 steps" in planar
    assert "pulls at the tip and jumps to another one every 15 steps" in planar and "The load is not" in planar
    arm = description(
        FlexibleArmConfig(
            mechanism="small_arm",
            observe_load=True,
            orientation=True,
            gravity={"tilt": [0.0, 0.5]},
            load={"magnitude": [0.1, 0.4], "process": "ou"},
            target={"process": "path"},
            randomization={"position_noise_mm": 1.0, "weight_spread": 0.1},
        )
    )
    assert "small_arm (4 beads, 4 tendons, 80 mm): the tip follows a path through 3 points" in arm
    assert (
        "hangs from a base that is tilted by up to 29°; a payload of 0.1 to 0.4 N hangs from its tip and drifts" in arm
    )
    assert "Tilt and payload are observed." in arm and "turn into that of the target, too." in arm
    assert "noisy (standard deviations 1 mm and 0 rad)" in arm and "off: every weight by up to 10 %." in arm


def test_the_goal_environment_s_policies_belong_to_the_same_task():
    goal = EnvConfig("rj_gym/FlexibleArmGoal-v0", settings={"mechanism": "small_arm"})
    runs = [FinishedRun(RunFolder(Path()), TrainConfig(env=env), 0.0, np.zeros((3, 1))) for env in (goal, EnvConfig())]
    arm, planar = (Benchmark("some", [Recipe("one", [run])]) for run in runs)
    assert arm.env == EnvConfig("rj_gym/FlexibleArm-v0", settings={"mechanism": "small_arm"})
    assert planar.complexity == (0, 0) and arm.complexity == (2, 1)


def test_a_benchmark_with_friction_is_described():
    env = EnvConfig(settings={"friction": {"mu": [0.02, 0.1], "shared": False}})
    text = description(env.arguments()["config"])
    assert "hidden coefficient between 0.02 and 0.1, its own for every tendon." in text


def test_curves_are_drawn_for_what_the_task_varies_and_shifts_for_its_id():
    plan = ScoringPlan(range(5), range(3), 2)
    rubbing = worlds_of(EnvConfig(settings={"friction": {"mu": [0.0, 0.24]}}), plan)
    assert [world.value for world in rubbing if world.axis.startswith("coefficient")] == [0, 0.06, 0.12, 0.18, 0.24]
    loads = [world for world in rubbing if world.axis == "load [N]"]
    assert [world.changes["load"]["magnitude"] for world in loads] == [[v, v] for v in (0, 0.25, 0.5, 0.75, 1, 1.25)]
    assert {world.axis for world in rubbing if world.axis} == {"coefficient of friction in the holes", "load [N]"}
    seen = worlds_of(EnvConfig(settings={"observe_load": True}), plan)
    assert [world.name for world in seen] == [TEST, VALIDATION]
    assert [world.role for world in worlds_of(EnvConfig(), replace(plan, per_point=0))] == [TEST, VALIDATION, SHIFT]


def test_an_opponent_that_does_not_find_what_it_needs_is_left_out_and_says_why(monkeypatch):
    class Blind(Controller):
        """Asks for an entry that no environment shows."""

        def act(self, observations):
            return self.read(observations)._entries("the truth")

    others = roster.candidates("rj_gym/RollingJoint-v0")
    monkeypatch.setattr(roster, "candidates", lambda world: others | {"blind": Blind()})
    able, impossible = opponents(EnvConfig())
    assert able.keys() == others.keys() and impossible.keys() == {"blind"}
    assert "observation entry = 'the truth': expected one of link 1 x" in impossible["blind"]


def test_a_task_with_play_and_late_pictures_is_described():
    text = _actuation(ActuationConfig(play_mm=(0.5, 3.0), sheath_friction=(0.0, 0.6), rate_limit_mm=0.5, delay=2))
    assert "a play of 0.5 to 3 mm between motor and tendon and sheath friction of 0 to 0.6 that" in text
    assert text.endswith("Motors move by at most 0.5 mm in a step. Actions act 2 steps late.")
    assert _actuation(ActuationConfig()) == _sensing(SensingConfig()) == ""
    late = SensingConfig(period=5, delay=3, tension_noise=0.1)
    assert _sensing(late) == (
        "A picture of the pose comes at every 5th step, 3 steps late. Measured tensions are noisy (standard deviation "
        "0.1 N)."
    )
    assert _sensing(SensingConfig(pose="none")) == "Neither pose nor tip is measured."


@pytest.mark.parametrize("world", ["Instrument", "InstrumentShift"])
def test_the_page_says_of_both_instruments_what_the_ideal_limit_of_tension_is_worth(world):
    note, docs = TASK_NOTES[f"rj_gym/{world}-v0"], Path(__file__).parents[3] / "docs"
    assert note in " ".join((docs / "results.md").read_text("utf-8").split())
    rows = re.findall(rf"^\| {world} \|.*", (docs / "policies.md").read_text("utf-8"), re.MULTILINE)
    cells = [[cell.split()[0] for cell in row.split("|")[2:5]] for row in rows]
    limits = [limit for limit in re.findall(r"(\S+) N\b", note) if limit != "15"]
    policy, bank = re.findall(r"(\S+) mm at", note), re.findall(r"bank at (\S+) and (\S+) mm", note)[0]
    figures = [[*row] for row in zip(limits, policy, bank, strict=True)]
    assert len(figures) == 2 and all(row in cells for row in figures)


def test_a_task_with_another_limit_of_tension_has_no_note_on_the_ideal_one():
    as_it_is, changed = (
        SimpleNamespace(env_id="rj_gym/Instrument-v0", settings={"tension_range": [0.5, high]}) for high in (15.0, 30.0)
    )
    assert "15 N" in task_note(as_it_is) and task_note(changed) == ""


def test_animations_become_smaller_until_they_fit(monkeypatch):
    frames = {"one": list(np.random.default_rng(0).integers(0, 255, (50, 60, 60, 3), np.uint8))}
    monkeypatch.setattr(films, "SIZES", ((60, 60), (60, 10), (30, 5)))
    largest = len(films.small_animation(frames))
    assert largest <= films.LARGEST
    monkeypatch.setattr(films, "LARGEST", largest // 2)
    smaller = films.small_animation(frames)
    with Image.open(io.BytesIO(smaller)) as picture:
        assert len(smaller) <= largest // 2 and picture.n_frames == 10 and picture.width == 60


def test_runs_that_began_from_runs_of_their_own_seed_are_one_recipe():
    settings = {"algorithm": "apg", "env": {"id": "rj_gym/Instrument-v0"}, "normalise": {"reward": False}}
    fresh = TrainConfig.from_dict(settings)
    one, other = (replace(fresh, seed=seed, start_from=f"/runs/first/seed_{seed}") for seed in (1, 2))
    assert _without_seed(one) == _without_seed(other) != _without_seed(fresh)


def test_the_motors_and_sensors_of_version_1_are_described():
    text = description(InstrumentV1Config())
    assert "from measured tensions of 3 N" in text and "limit, 10 to 30 N" in text and "0.02 mm" in text
    assert text != description(InstrumentConfig())


def test_an_instrument_at_any_attitude_is_described_and_its_opponents_are_those_that_see_the_tip():
    env = EnvConfig("rj_gym/PitchYaw-v0")
    text = description(env.arguments()["config"])
    assert (
        "It is held at any attitude; a payload of 0 to 0.2 N hangs from its tip. Attitude and payload are not" in text
    )
    assert list(opponents(env)[0]) == list(untuned_controllers())
    found = worlds_of(env, ScoringPlan(range(9_000_000, 9_000_004), range(2), 2))
    assert [world.heading for world in found if world.role == SHIFT] == ["Heavier loads than in training, 0.2 to 0.3 N"]
    assert {world.axis for world in found if world.role == SWEEP} == {"load [N]"}
