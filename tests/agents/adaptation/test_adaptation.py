"""Adapting to one robot: the bench, identification, controllers that know the twin, the command."""

import json
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import torch

from agents import adapt
from agents.adaptation import bench, trial, tuning
from agents.adaptation.bench import FIRST_STEPS, Bench, record, sweeps
from agents.adaptation.controllers import InstrumentController
from agents.adaptation.driving import WORLD, seeds_of
from agents.adaptation.fine_tuning import FineTuning, fine_tuned, loss_of
from agents.adaptation.identify import BELIEFS, KINDS, Identified, Space, identify, rig_recording
from agents.adaptation.informed import Informed
from agents.adaptation.robot import robot
from agents.adaptation.trial import RobotTrial, TrialOutcome, TrialPlan, gains, leads, trial_table
from agents.adaptation.world import LikelyRobots, likely
from agents.controllers.controller import Controller, Reading
from agents.controllers.tuned import tuned_controllers
from agents.learners.episodes import Played
from agents.learners.recurrent import RecurrentActor
from agents.policies.conversion import actor_of, recurrent_network
from agents.policies.shipped import ShippedPolicy, entry_names, standalone
from agents.runs.environment import EnvConfig, make_vector_env
from agents.runs.seeds import BENCH
from rollingjoint import five_link
from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.identify.beliefs import RigSpace
from rollingjoint.identify.rig import Misfit
from rollingjoint.identify.twin import RigModel

NUMBER = 1_000


@pytest.fixture(scope="module")
def recording():
    return record(robot(NUMBER), 3, sees_tip=True)


@pytest.fixture(scope="module")
def known():
    """As if a robot had been identified to the last digit but for its surfaces."""
    space, one = Space(), robot(NUMBER)
    values = space.vector(
        {name: getattr(one, name) for name in BELIEFS if name != "surface_errors"} | {"surface_errors": 0.0}
    )
    return Identified(NUMBER, values, 1e-8 * np.diag(space.sd**2), 0.5, 10.0)


@pytest.fixture(scope="module")
def policy():
    settings = EnvConfig(WORLD, settings={"observe_history": 1}).arguments()["config"]
    names = entry_names(settings, False)
    torch.manual_seed(0)
    network = recurrent_network(RecurrentActor(len(names), 2, width=8))
    training = {"config": {}, "steps": 0, "seed": 1, "versions": {}}
    return ShippedPolicy("small", "apg", network, WORLD, standalone(settings), names, training)


def test_sweeps_turn_around_and_move_a_millimetre_a_step_at_most():
    paths = sweeps(np.random.default_rng(1), 20, 50, 2)
    assert paths.shape == (20, 50, 2)
    assert np.abs(np.diff(np.concatenate([np.zeros((20, 1, 2)), paths], axis=1), axis=1)).max() <= 1.0 + 1e-12
    apart = paths[..., 0] - paths[..., 1]
    assert (apart.max(axis=1) > 6).all() and (apart.min(axis=1) < -6).all()


def test_the_bench_has_seeds_of_its_own_no_load_and_the_same_noise_every_time(recording):
    again = record(robot(NUMBER), 3, sees_tip=True)
    np.testing.assert_array_equal(again.tips, recording.tips)
    np.testing.assert_array_equal(again.tensions, recording.tensions)
    assert all(seed in BENCH and seed not in seeds_of(robot(NUMBER), 1000) for seed in recording.seeds)
    assert recording.motors.shape == recording.tensions.shape == (3, 51, 2) and recording.running.all()
    assert record(robot(NUMBER), 1, sees_tip=False).tips is None
    quiet = Bench(3)
    true = quiet.follow(robot(NUMBER), recording.seeds, recording.motors[:, 1:])
    quiet.close()
    assert 0.05 < np.std(recording.tensions[:, FIRST_STEPS:] - true.tensions[:, FIRST_STEPS:]) < 0.2
    assert 0.1 < np.std(recording.tips[:, FIRST_STEPS:] - true.tips[:, FIRST_STEPS:]) < 0.3


def misfit_of(recording):
    rigs = RigSpace(five_link(), list(KINDS.values()), {KINDS[name]: belief for name, belief in BELIEFS.items()})
    return Misfit(RigModel(rig_recording(recording), rigs, limits=(0.5, 15.0), first=FIRST_STEPS))


def test_a_model_that_is_the_robot_leaves_the_noise_of_the_sensors_and_another_much_more(recording):
    one, misfit, space = robot(NUMBER), misfit_of(recording), Space()
    values = space.vector({name: getattr(one, name) for name in BELIEFS})
    assert 0.3 < misfit.rms((values - space.mean) / space.sd) < 0.7 and misfit.rms(np.zeros(values.size)) > 5


def test_what_ends_early_is_not_compared_and_no_search_goes_to_a_model_without_equilibria(recording, monkeypatch):
    cut = replace(recording, running=recording.running & (np.arange(51) < 30))
    misfit, whole = misfit_of(cut), misfit_of(recording)
    assert misfit.size < whole.size == whole(np.zeros(40)).size - 40
    predict = whole.model.predict
    monkeypatch.setattr(whole.model, "predict", lambda x: predict(x)._replace(ok=np.zeros((len(x), 3, 51), bool)))
    assert (whole.of_all(np.zeros((1, 40)))[0, :-40] == 10.0).all()
    assert np.isinf(whole(np.zeros(40))).all()  # no search goes there


def test_identification_without_a_camera_finds_play_friction_and_stiffness_and_leaves_surfaces(recording):
    told = []
    found = identify(replace(recording, tips=None), NUMBER, evaluations=12, say=lambda: told.append(1))
    one, twin, space = robot(NUMBER), found.twin, Space()
    assert found.residual < 0.3 * found.before and 1 <= len(told) <= 16
    np.testing.assert_allclose(twin.play_mm, one.play_mm, atol=0.4)
    np.testing.assert_allclose(twin.sheath_friction, one.sheath_friction, atol=0.1)
    np.testing.assert_allclose(twin.stiffness, one.stiffness, atol=0.15)
    assert (twin.surface_errors == 0).all()
    np.testing.assert_allclose(found.sd["surface_errors"].ravel(), space.sd[space.surfaces :])
    assert (found.sd["play_mm"] < 0.2).all()
    drawn = list(islice(likely(found), 20))
    assert 0 < np.std([each.play_mm for each in drawn], axis=0).max() < 0.4 and drawn[0].number == NUMBER


class Listens(Controller):
    """Keeps its task and its readings."""

    def act(self, observations):
        self.seen = self.read(observations)
        return np.zeros((len(observations), 2))


def test_informed_controllers_see_the_same_target_and_lengths_with_the_offsets_of_the_motors(known):
    envs = make_vector_env(EnvConfig(WORLD), 2)
    observation, _ = envs.reset(seed=[1, 2])
    told = Informed(Listens(), known)
    told.begin(envs.task, 2)
    told.act(observation)
    plain, seen = Reading(observation, envs.task), told.controller.seen
    np.testing.assert_array_equal(seen.target, plain.target)
    np.testing.assert_allclose(seen.commands, plain.commands + robot(NUMBER).motor_offsets)
    np.testing.assert_allclose(seen.task.mechanism.stiffnesses, robot(NUMBER).chain.stiffnesses)
    assert envs.task.mechanism is not seen.task.mechanism
    envs.close()


def test_filters_assume_what_was_identified(known):
    shipped = tuned_controllers(WORLD)["probing bank"]
    found = Informed(shipped, known).controller.settings
    low, high = found.filter.play_mm
    assert low < robot(NUMBER).play_mm.min() and robot(NUMBER).play_mm.max() < high < low + 1.5
    assert found.feedback == shipped.settings.feedback and shipped.settings.filter.play_mm is None


def test_the_best_settings_in_simulation_are_kept(known, monkeypatch):
    errors, made = iter([3.0, 1.0, 2.0]), []

    def simulated(controller, drawn, episodes):
        made.append(controller)
        return np.full((len(drawn), episodes), next(errors))

    monkeypatch.setattr(tuning, "simulated_errors", simulated)
    told = []
    found = tuning.tuned("bank of filters", known, 3, told.append)
    assert told == [3.0, 1.0, 2.0]
    assert found.controller.settings == made[1].controller.settings != made[0].controller.settings
    assert tuning.tuned("bank of filters", known, 0).controller.settings == made[0].controller.settings


def test_episodes_of_likely_robots_are_each_of_the_next_one(known):
    envs = LikelyRobots(2, iter([robot(0), robot(1)]), {"observe_history": 1})
    for number in range(2):
        _, info = envs.reset(seed=3)
        np.testing.assert_allclose(info["sampled"]["play_mm"], np.tile(robot(number).play_mm, (2, 1)))
    envs.close()


def test_an_actor_of_a_network_is_that_network(policy):
    again = recurrent_network(actor_of(policy.network))
    assert all(
        (again.tensors()[name] == array).all() for name, array in policy.network.tensors().items() if name != "clip"
    )


def test_fine_tuning_changes_the_layers_but_not_how_observations_are_normalised(policy, known):
    settings, losses = {"observe_history": 1}, []
    same = fine_tuned(policy, settings, known, FineTuning(updates=0, lanes=2))
    assert same.sha256 == policy.sha256
    found = fine_tuned(policy, settings, known, FineTuning(updates=1, lanes=2), losses.append)
    assert len(losses) == 1 and losses[0] > 0
    changed = {
        name for name, array in found.network.tensors().items() if (array != policy.network.tensors()[name]).any()
    }
    assert changed >= {"cell.input_weights"} and not changed & {"mean", "scale", "clip", "low", "high"}


def test_the_loss_counts_the_last_steps_once_and_all_of_them_a_little():
    errors, running = torch.ones(20, 2), torch.ones(20, 2, dtype=torch.bool)
    errors[-10:], running[15:, 1] = 2.0, False
    empty = torch.zeros(0)
    loss = loss_of(Played(errors, empty, running, empty, empty), FineTuning(whole_weight=0.1))
    assert loss.item() == pytest.approx(2.0 + 0.1 * (20 + 2 * 15) / 35)


def outcome(before: float, after: float) -> TrialOutcome:
    return TrialOutcome(np.full(2, before), np.full(2, after), 1.0, InstrumentController(None))


def test_gains_are_over_robots_and_the_best_adapted_controller_comes_first(known):
    trials = [
        RobotTrial(robot(number), known, 1.0, {"a": outcome(4.0, 4.0 - gain), "b": outcome(2.0, 2.0 + 0.5 * gain)})
        for number, gain in enumerate((1.0, 3.0))
    ]
    before, after, change = gains(trials, "a")
    assert (before.value, after.value) == (4.0, 2.0) and change == (-2.0, -3.0, -1.0)
    first, second = trial_table(trials).splitlines()[2:]
    assert first.split()[0] == "a" and "2 of 2" in first and second.split()[0] == "b" and "0 of 2" in second
    assert leads(trials) == "a minus b: -1.00 [-2.50, 0.500] mm, better on 1 of 2"


@pytest.fixture
def quick(monkeypatch, known):
    """No bench, and no more than a list of what was adapted."""
    monkeypatch.setattr(trial, "record", lambda one, episodes, sees_tip: (episodes, sees_tip))
    monkeypatch.setattr(trial, "identify", lambda recording, number, say: replace(known, number=number))


def test_the_command_writes_robots_errors_and_what_was_identified(quick, tmp_path, policy, capsys):
    (tmp_path / "small.safetensors").write_bytes(policy.to_bytes())
    words = ["--development", "--robot", "1000", "--robot", "1001", "--tries", "0", "--updates", "0", "--scored", "1"]
    names = ["--controller", "open loop", "--controller", str(tmp_path / "small.safetensors")]
    out = ["--out", str(tmp_path / "found.json"), "--policies", str(tmp_path / "adapted")]
    assert adapt.main([*words, *names, *out]) == 0
    content = json.loads((tmp_path / "found.json").read_text())
    assert content["version"] == 1 and content["plan"]["scored"] == 1
    assert [each["robot"] for each in content["robots"]] == [1000, 1001]
    first = content["robots"][0]
    np.testing.assert_allclose(first["identified"]["play_mm"]["value"], robot(1000).play_mm, rtol=1e-3)
    of_policy = first["controllers"]["small"]
    assert of_policy["before_mm"] == of_policy["after_mm"] and len(of_policy["after_mm"]) == 1
    assert first["controllers"]["open loop"]["before_mm"] != first["controllers"]["open loop"]["after_mm"]
    assert (tmp_path / "adapted" / "small_robot_1001.safetensors").is_file()
    assert "robot 1001: small" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--robot", "0", "--development"], "--robot = 0: expected an integer from 1000 to 1049"),
        (["--robots", "0"], "--robots"),
        (["--episodes", "0"], "--episodes"),
        (["--updates", "-1"], "--updates"),
        (["--controller", "privileged teacher"], "It knows all"),
        (["--controller", "open lop"], "open loop"),
    ],
)
def test_what_cannot_be_adapted_is_refused_in_one_line(words, said, capsys):
    assert adapt.main([*words, *([] if "--controller" in words else ["--controller", "open loop"])]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_policies_without_the_memory_that_is_trained_on_are_refused(policy, known):
    plain = replace(policy, network=replace(policy.network, shortcut=False, layers=[
        (policy.network.layers[0][0][:, :8], policy.network.layers[0][1]), policy.network.layers[1],
    ]))  # fmt: skip
    with pytest.raises(ConfigError, match="apg or distill"):
        fine_tuned(plain, {}, known)
    with pytest.raises(ConfigError, match="updates"):
        FineTuning(updates=-1)
    with pytest.raises(ConfigError, match="--tries"):
        TrialPlan(tries=-1)
    with pytest.raises(InvalidInput, match="bench"):
        bench.record(robot(0), 0, True)
