"""Identification of rigs from recordings: what is found, how sure it is, what is written, the command."""

import json

import gymnasium
import numpy as np
import pytest
import yaml

from rollingjoint import five_link, flexible_arm, reach, solve_lengths
from rollingjoint.cli import main
from rollingjoint.errors import InvalidInput
from rollingjoint.identify import identify_rig, read_recording, write_recording
from rollingjoint.identify.beliefs import RigSpace
from rollingjoint.identify.rig import LOST, Misfit
from rollingjoint.identify.rig_files import environment_settings
from rollingjoint.identify.twin import RigModel
from rollingjoint.io.mechanism_file import load_mechanism

from .rigs import TRUE, recorded, with_stiffness

DRIVE = ("play", "sheath", "stiffness", "offsets")


@pytest.fixture(scope="module")
def found():
    return identify_rig(recorded(), kinds=DRIVE)


def test_play_sheath_stiffness_and_offsets_are_found_within_what_is_said_of_them(found):
    assert found.residual < 0.4 < 10 * found.residual < found.before * 10
    for name in DRIVE:
        np.testing.assert_allclose(found.fields[name], TRUE[name], atol=0.06)
        assert (np.abs(found.fields[name] - TRUE[name]) < 4 * found.sd[name]).all()
    assert found.deviations["tension"] == pytest.approx(0.05, rel=0.2)
    assert found.deviations["position"] == pytest.approx(0.05, rel=0.2)


def open_loop_errors(chain, offsets, count, play_side):
    """Tip errors where motors go to the lengths with which the model of a rig reaches targets, (count,) [mm]."""
    rng, true = np.random.default_rng(5), with_stiffness(five_link(), TRUE["stiffness"])
    errors = []
    for _ in range(count):
        tensions = rng.uniform(3.0, 9.0, 2)
        from rollingjoint import solve_tensions

        target = solve_tensions(five_link(), tensions).tip[:2]
        model = reach(chain, target, tension_limits=(1.0, 12.0))
        motors = model.equilibrium.lengths - model.equilibrium.tensions / chain.stiffnesses - offsets - play_side
        arrived = solve_lengths(true, motors + 0.5 * np.array(TRUE["play"]) + TRUE["offsets"])
        errors.append(np.linalg.norm(arrived.tip[:2] - target))
    return np.array(errors)


def test_a_model_from_a_recording_takes_open_loop_from_millimetres_to_a_tenth(found):
    before = open_loop_errors(five_link(), 0.0, 40, 0.0).mean()
    after = open_loop_errors(found.mechanism, found.offsets, 40, 0.5 * found.fields["play"]).mean()
    assert before > 1.0 and after < 0.1


@pytest.mark.slow
def test_intervals_hold_the_true_numbers_about_as_often_as_they_say():
    inside = []
    for seed in range(12):
        result = identify_rig(recorded(160, seed), kinds=DRIVE)
        truth = result.space.vector(TRUE)
        inside.append((result.intervals[:, 0] <= truth) & (truth <= result.intervals[:, 1]))
    assert 0.85 <= np.mean(inside) <= 1.0


def test_no_search_ends_where_most_readings_have_no_equilibrium():
    space = RigSpace(five_link(), DRIVE)
    misfit = Misfit(RigModel(recorded(80), space))
    slack, start = (
        (space.vector(space.fields(space.mean) | values) - space.mean) / space.sd
        for values in ({"offsets": 4.0}, {"play": 6.0, "offsets": -2.0})
    )
    assert np.isinf(misfit(slack)).all() and not misfit.solvable(slack)
    np.testing.assert_allclose(misfit.fitted(slack, 4, lambda: None), slack)
    assert misfit.rms(start) > LOST  # more than without any equilibrium
    assert misfit.solvable(misfit.fitted(start, 4, lambda: None))


def test_a_delay_is_found_in_seconds():
    result = identify_rig(recorded(delay=3, noise=(0.02, 0.02)), kinds=[*DRIVE, "delay"])
    assert result.fields["delay"][0] == pytest.approx(0.15, abs=0.01)
    np.testing.assert_allclose(result.fields["play"], TRUE["play"], atol=0.15)


def test_friction_in_the_holes_is_sought_step_by_step(found):
    result = identify_rig(recorded(120), kinds=[*DRIVE, "mu"])
    assert (result.fields["mu"] < 0.02).all() and result.residual < 0.4


def test_samples_spread_as_the_intervals_say_and_stay_within_bounds(found):
    samples = found.drawn(np.random.default_rng(0), 2000)
    np.testing.assert_allclose(samples.std(axis=0), np.sqrt(np.diag(found.covariance)), rtol=0.1)
    assert (samples >= found.space.low).all() and (samples <= found.space.high).all()


def test_arms_have_hinge_stiffness_and_hole_angles_in_place_of_surfaces():
    arm = flexible_arm()
    space = RigSpace(arm, ["stiffness", "hinge_stiffness", "hole_angles"])
    vector = space.vector({"stiffness": 1.1, "hinge_stiffness": 1.2, "hole_angles": 0.02})
    chain = space.chain(vector)
    assert chain.beads[0].stiffness == pytest.approx(1.2 * arm.beads[0].stiffness)
    (x, y), (a, b) = arm.tendons[0].holes[0], chain.tendons[0].holes[0]
    assert np.arctan2(b, a) - np.arctan2(y, x) == pytest.approx(0.02)
    for wrong in ("surfaces", "plya"):
        with pytest.raises(InvalidInput, match=wrong):
            RigSpace(arm, [wrong])


def test_the_command_writes_a_mechanism_and_an_environment_that_trains_as_they_are(tmp_path, capsys, found):
    import rj_gym  # registers the environments

    assert rj_gym.IDS
    write_recording(recorded(), tmp_path / "bench.jsonl")
    arguments = [str(tmp_path / "bench.jsonl"), "--parameters", ",".join(DRIVE), "--output", str(tmp_path / "found")]
    assert main(["identify", *arguments]) == 0
    printed = capsys.readouterr().out
    assert "play[0]" in printed and "pretension" in printed
    chain = load_mechanism(str(tmp_path / "found" / "mechanism.yaml"))
    np.testing.assert_allclose(chain.stiffnesses, found.mechanism.stiffnesses, rtol=1e-4)
    content = yaml.safe_load((tmp_path / "found" / "environment.yaml").read_text())
    low, high = content["actuation"]["play_mm"]
    assert 0.7 < low < 0.9 and 1.4 < high < 1.6 and content["randomization"]["stiffness_spread"] < 0.05
    identified = yaml.safe_load((tmp_path / "found" / "identified.yaml").read_text())
    np.testing.assert_allclose(identified["offsets"], TRUE["offsets"], atol=0.1)
    env = gymnasium.make("rj_gym/Instrument-v1", **(content | {"mechanism": chain}))
    env.reset(seed=1)
    assert env.step(np.zeros(2))[0].shape == env.observation_space.shape
    env.close()
    assert len((tmp_path / "found" / "samples.csv").read_text().splitlines()) == 501
    assert main(["identify", *arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parameters"]["play[0]"]["value"] == pytest.approx(0.9, abs=0.1)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--given", "lengths"], "--given"),
        (["--parameters", "plya"], "Did you mean 'play'?"),
        (["--mechanism", "flexible_arm"], "tendons of the recording"),
    ],
)
def test_wrong_options_of_recordings_are_one_line(tmp_path, capsys, words, said):
    write_recording(recorded(20), tmp_path / "short.jsonl")
    assert main(["identify", str(tmp_path / "short.jsonl"), *words]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_a_recording_without_tensions_and_tips_says_so(tmp_path):
    (tmp_path / "motors.csv").write_text("t,motor0,motor1\n0,90,97\n0.1,89,98\n")
    with pytest.raises(InvalidInput, match="Move more"):
        identify_rig(read_recording(tmp_path / "motors.csv"), five_link(), DRIVE)


def test_ranges_are_those_of_the_environment_and_get_narrower_with_data(found):
    settings = environment_settings(found)
    assert set(settings) == {"actuation", "randomization"}
    wide = environment_settings(identify_rig(recorded(60), kinds=DRIVE))
    assert wide["randomization"]["stiffness_spread"] > settings["randomization"]["stiffness_spread"]
