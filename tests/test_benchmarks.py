"""The speed page: every row is measured, and the peers that it compares with solve the same physics."""

import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"

EVERY_ROW = [
    "warm solve, compiled, one by one",
    "warm solve, compiled, side by side",
    "warm solve, prepared",
    "warm solve, public",
    "256 lanes, 1 thread",
    "256 lanes of 64 mechanisms",
    "iteration, 1 lane ",
    "iteration, 64 lanes",
    "iteration, 2 links",
    "iteration, 50 links",
    "iteration, 8 tendons",
    "iteration, a force on every link",
    "iteration, 100 links",
    "exponent from 100 links on",
    "tensions, batch of 40, 1 thread",
    "lengths, batch of 40, 1 thread",
    "tensions, public",
    "lengths, public",
    "rj_gym/RollingJoint-v0",
    "rj_gym/RollingJoint-v0, 16 lanes",
    "rj_gym/FlexibleArm-v0, 16 lanes",
    "rj_gym/ArmInstrument-v1, 8 lanes",
    "PPO, 64 lanes",
    "share of the rate at no cost, 64 lanes",
    "demo, 16 lanes: environment step",
    "demo, 16 lanes: gradient update",
    "1,024 lanes: rollout inference",
    "import rollingjoint",
    "import rj_gym",
    "first solve after the import, kernels on disk",
    "first solve ever, kernels compiled",
    "`rj warmup planar --without-walls` ever",
    "`rj warmup` ever",
    "solve_lengths_batch, per lane",
    "vector environment, per lane",
    "compiled warm solve, one by one",
    "compiled warm solve, side by side",
]
EVERY_PEER = [
    "scipy.optimize.root",
    "published tension algorithm",
    "published displacement algorithm",
    "MuJoCo until rest",
    "loop over solve_lengths",
    "Reacher-v5",
    "CartPole-v1 |",
    "CartPole-v1, native",
    "the same at no cost",
    "commit c7882b5",
]


@pytest.fixture(autouse=True)
def benchmarks_on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))


@pytest.fixture
def walk():
    from speed_rows.walk import random_walk

    return random_walk(12)


@pytest.mark.slow
def test_the_quick_page_has_every_row_peer_and_picture(run_python, tmp_path):
    page = tmp_path / "speed.md"
    run_python(str(BENCHMARKS / "speed.py"), "--quick", "--output", str(page))
    text = page.read_text("utf-8")
    assert [row for row in EVERY_ROW if f"\n| {row}" not in text] == []
    assert [peer for peer in EVERY_PEER if peer not in text] == []
    assert "## Where a training run spends its time" in text and "numba" in text
    for name in ("speed_batch.png", "speed_links.png", "speed_vector_env.png"):
        assert f"(images/{name})" in text
        assert (tmp_path / "images" / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_training_ends_where_a_policy_is_good_or_its_time_is_over():
    from speed_rows.controllers import PLAIN, ROOT, arrival, best_known

    from agents.runs.config import load_config

    path = ROOT / "configs/train/apg_fixed_target.yaml"
    changes = ["evaluation.episodes=20", "env.settings={episode_steps: 20}", "policy.hidden=[8]"]
    config = load_config(path, [*changes, "total_timesteps=64_000"])
    good = arrival(config, 1.0, 1_280, 60.0)
    assert good.arrived and good.error <= 1.0 and 0.0 < good.seconds < 60.0
    brief = "parameters={n_steps: 64}"
    late = arrival(load_config(path, [*changes, *PLAIN, brief]), 1e-6, 1_280, 0.1)
    assert not late.arrived and late.error > 0.01 and 0.1 <= late.seconds < 20.0
    assert 0.01 < best_known("fixed_target") < 0.06


@pytest.mark.slow
def test_one_section_is_printed_alone(capsys):
    import speed

    speed.main(["--quick", "--only", "solver"])
    captured = capsys.readouterr()
    assert captured.out.startswith("## One warm solve") and captured.out.count("\n| warm solve") == 4
    assert "solver: warm solve, public: " in captured.err


def test_scipy_finds_our_equilibria(walk):
    from speed_rows.scipy_equilibrium import solve_by_root
    from speed_rows.walk import TENSION_LIMITS

    for step in range(1, len(walk)):
        start, ours = walk.equilibria[step - 1 : step + 1]
        poses = solve_by_root(walk.mechanism, walk.commands[step], walk.loads(step), start, TENSION_LIMITS)
        assert np.abs(poses - ours.poses[1:]).max() < 1e-6
        assert np.abs(poses - start.poses[1:]).max() > 1e-3  # it had to move


@pytest.mark.parametrize("given", ["tensions", "lengths"])
def test_scipy_finds_our_equilibria_of_the_arm(given):
    from speed_rows.arm import batch_of, by_root, cases

    every = cases(3)
    ours = batch_of(every, given)()
    assert np.all(ours.ok) and ours.residual.max() < 1e-8
    assert np.abs(by_root(every, given, 3) - ours.joint_angles).max() < 1e-8
    assert np.abs(ours.joint_angles - every.start.joint_angles).max() > 1e-3  # they had to move


@pytest.mark.parametrize("way", ["one_by_one", "side_by_side"])
def test_the_compiled_walk_has_the_public_answers(walk, way):
    from speed_rows.walk import CompiledWalk

    compiled = CompiledWalk(walk)
    compiled.results.joint_angles[:] = np.nan
    getattr(compiled, way)()
    public = np.array([equilibrium.joint_angles for equilibrium in walk.equilibria])
    np.testing.assert_allclose(compiled.results.joint_angles, public, rtol=0, atol=1e-9)


@pytest.mark.slow  # compiles two kernels that nothing else needs
@pytest.mark.parametrize("way", ["one_by_one", "side_by_side", "batch"])
def test_the_bare_kernel_has_the_public_answers(walk, way):
    from speed_rows.limit import BareWalk

    public = np.array([equilibrium.joint_angles for equilibrium in walk.equilibria])
    bare = BareWalk(walk, 2 * len(walk) + 1)  # no multiple of eight, and the walk starts over
    assert np.isnan(bare.joint_angles).all()
    getattr(bare, way)()
    np.testing.assert_allclose(bare.joint_angles[: len(walk)], public, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(bare.joint_angles[-1], bare.joint_angles[0])


@pytest.mark.slow
def test_a_bare_kernel_with_other_answers_is_no_limit(walk, monkeypatch):
    from speed_rows import limit

    monkeypatch.setattr(limit, "AGREEMENT", 1e-15)
    with pytest.raises(RuntimeError, match=r"misses \d+ of 12 answers"):
        limit.BareWalk(walk)


def test_a_limit_stands_in_the_row_and_is_no_peer():
    from speed_rows.row import LIMIT, Row, timed_row
    from speed_rows.timing import Timing

    row = timed_row("solve", "µs", {"ours": Timing(6e-6, 1, 1), LIMIT: Timing(2e-6, 1, 1), "peer": Timing(9e-6, 1, 1)})
    assert row.markdown() == "| solve | 6 µs |  | 2 µs, × 3 | peer | 9 µs | 1.5 | best of 1 × 1 |"
    assert "| 12 M steps/s, × 3 |" in Row("rate", 4e6, "steps/s", limit=12e6).markdown()
    assert row.best(Row("solve", 7.0, "µs", peers=row.peers, limit=1.5)).limit == 1.5
    assert row.best(Row("solve", 5.0, "µs", peers=row.peers)).limit == pytest.approx(2.0)


def test_the_mujoco_chain_comes_to_rest_and_bends_with_its_tendons(walk):
    pytest.importorskip("mujoco")
    from speed_rows.mujoco_chain import MujocoChain
    from speed_rows.walk import TENSION_LIMITS

    chain = MujocoChain(walk.mechanism, TENSION_LIMITS)
    neutral = walk.mechanism.neutral_lengths
    for command, force in zip(walk.commands, walk.forces, strict=True):
        steps = chain.settle(neutral - command, force)
        tip = chain.tip
        chain._engine.mj_step(chain.model, chain.state, 2000)
        assert 0 < steps < 200
        assert np.abs(chain.tip - tip).max() < 0.01
    no_force = np.zeros(2)
    chain.settle(np.array([4.0, -3.0]), no_force)
    left = chain.tip[0]
    chain.settle(np.array([-3.0, 4.0]), no_force)
    assert left < -5.0 and chain.tip[0] == pytest.approx(-left, abs=0.05)


@pytest.mark.slow
def test_a_peer_that_is_not_installed_says_so(walk, monkeypatch):
    from speed_rows import solver
    from speed_rows.row import timed_row
    from speed_rows.timing import Contestant, race

    monkeypatch.setitem(sys.modules, "mujoco", None)  # None makes an import fail
    timings = race({"ours": Contestant(lambda: None, 1), "MuJoCo": solver._mujoco(walk)}, 1)
    assert "| MuJoCo (not installed) | – |" in timed_row("solve", "µs", timings).markdown()


def test_ratios_above_one_mean_that_ours_is_faster():
    from speed_rows.row import Peer, Row

    slow_peer, few_peers = Peer("peer", 40.0), Peer("peer", 5.0)
    assert Row("time", 10.0, "µs").times_faster(slow_peer) == 4.0
    assert Row("rate", 10.0, "steps/s").times_faster(few_peers) == 2.0


def test_a_missed_target_is_named_on_the_page():
    from speed_rows.page import page
    from speed_rows.row import Row, Target

    class Section:
        TITLE, TEXT = "Title", "Text."

    met, missed = Row("met", 1.0, "µs", target=Target(2.0)), Row("late", 3.0, "µs", target=Target(2.0))
    assert "All 1 targets are met." in page([(Section, [met])], 1)
    text = page([(Section, [met, missed, Row("unknown", None, "µs", target=Target(2.0))])], 1)
    assert "1 of 2 targets are met. Missed:\n\n- late: 3 µs" in text
    assert "| late | 3 µs | ≤ 2 µs: **missed** |" in text


def test_the_power_law_of_exact_points_is_found():
    from speed_rows.long_chain import power_law

    exponent, (first, last) = power_law([(n, 3.0 * n**1.5) for n in (100, 200, 800)])
    assert exponent == pytest.approx(1.5)
    assert first == pytest.approx((100, 3000.0)) and last == pytest.approx((800, 3.0 * 800**1.5))


def test_of_two_rounds_each_contestant_keeps_its_faster_time_and_what_is_no_speed_stays():
    from speed_rows.row import Peer, Row

    first = Row("solve", 2.0, "µs", "first", peers=(Peer("peer", 30.0), Peer("absent", None, "not installed")))
    second = Row("solve", 3.0, "µs", "second", peers=(Peer("peer", 20.0), Peer("absent", None, "not installed")))
    best = first.best(second)
    assert (best.value, best.sample) == (2.0, "first")
    assert [peer.value for peer in best.peers] == [20.0, None]
    assert Row("rate", 2.0, "steps/s").best(Row("rate", 3.0, "steps/s")).value == 3.0
    assert Row("share", 90.0, "%").best(Row("share", 95.0, "%")).value == 90.0


def test_targets_of_the_arm_can_be_held_and_random_actions_end_nothing():
    import arm_task

    assert arm_task.held_errors(20).max() < 1
    assert arm_task.failures(arm_task.FlexibleArmVectorEnv(20, autoreset_mode="Disabled")) == 0


def test_random_actions_on_the_instrument_in_space_end_nothing_and_payloads_move_its_tip():
    import pitch_yaw_task

    config = pitch_yaw_task.PitchYawConfig()
    assert pitch_yaw_task.failures(pitch_yaw_task.PitchYawVectorEnv(20, config=config, autoreset_mode="Disabled")) == 0
    assert 2.0 < np.median(pitch_yaw_task.payload_shifts(config, 20)) < 6.0


@pytest.mark.slow
def test_every_opponent_of_a_world_is_timed(capsys):
    import opponents

    opponents.main(["rj_gym/SlowCamera-v0", "--lanes", "1", "3", "--rounds", "1"])
    rows = capsys.readouterr().out.splitlines()[2:]
    assert [row.split("  ")[0] for row in rows] == [*opponents.tuned_controllers("rj_gym/SlowCamera-v0"), "slow_camera"]
    assert all(float(row.split()[-1]) > 0.0 for row in rows)


@pytest.mark.slow
def test_every_controller_with_a_time_and_an_error_is_in_the_picture(tmp_path, capsys):
    import computation

    from agents.results import read_results

    path = tmp_path / "picture.png"
    computation.main(["--worlds", "SlowCamera-v0", "--lanes", "2", "--rounds", "1", "--picture", str(path)])
    rows = capsys.readouterr().out.splitlines()[2:]
    [scored] = [each for each in read_results(computation.RESULTS).benchmarks if each.env_id == "rj_gym/SlowCamera-v0"]
    tuned = computation.tuned_controllers(scored.env_id)
    names = [*(name for name in tuned if name in scored.names()), computation.LEARNER]
    assert len(names) > 5
    assert [row.split(" | ")[1] for row in rows] == names
    assert path.read_bytes().startswith(b"\x89PNG")


def test_a_picture_has_a_panel_per_world_and_every_name_once_in_its_legend():
    import computation

    point = computation.Point(3.0, computation.Interval(0.5, 0.4, 0.7))
    figure = computation.figure_with({"one": {"open loop": point}, "other": {"open loop": point, "policy": point}})
    assert [axes.get_title() for axes in figure.axes] == ["one", "other"]
    assert [text.get_text() for text in figure.legends[0].texts] == ["open loop", "policy"]


def test_episodes_that_fail_are_counted_beside_those_of_privileged_feedback(capsys):
    import opponents

    opponents.main(["rj_gym/LatePose-v0", "--episodes", "20", "--controllers", "open loop"])
    rows = [row.split() for row in capsys.readouterr().out.splitlines()[2:]]
    assert [row[0] for row in rows] == ["privileged", "open"] and [row[-2:] for row in rows[:1]] == [["0", "0"]]
    assert float(rows[1][2]) > float(rows[0][2]) and int(rows[1][-2]) >= int(rows[1][-1]) > 0


def test_at_the_limit_of_the_world_episodes_of_other_limits_are_those_of_the_tables():
    import tension_limit

    from agents.evaluation.rollout import run_episodes
    from agents.runs.environment import EnvConfig

    env = EnvConfig("rj_gym/Instrument-v0")
    bank = tension_limit.tuned_controllers(env.id)["probing bank"]
    driven = tension_limit.drive(env, bank, range(3), 15.0)
    np.testing.assert_array_equal(driven.errors, run_episodes(env, bank, range(3)).last_errors.mean(axis=1))
    assert 0.0 < driven.at_limit < 1.0


def test_another_limit_of_tension_moves_where_motors_give_way_and_no_unit():
    import tension_limit

    from agents.runs.environment import EnvConfig

    env, early = EnvConfig("rj_gym/Instrument-v0", settings={"sensing": {"tension_noise": 0.0}}), []
    for limit in (10.0, 15.0, 40.0):
        envs = tension_limit.limited_env(env, 4, limit)
        seen = [envs.reset(seed=0)[0]]
        for _ in range(15):
            observation, *_, info = envs.step(np.ones((4, 2), np.float32))
            seen.append(observation)
        assert info["tensions"].max() == limit and envs._buffer.tangent().held.any()
        early.append(np.stack(seen[:2]))  # no tendon is at a limit yet
    for other in early[1:]:
        np.testing.assert_array_equal(other, early[0])


@pytest.mark.slow
def test_the_table_of_other_limits_has_a_row_per_world_and_limit(tmp_path, capsys):
    import tension_limit

    tension_limit.main(["--episodes", "4", "--newtons", "15", "30"])
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in capsys.readouterr().out.splitlines()[2:]]
    worlds = ("Instrument", "InstrumentShift")
    assert [row[:2] for row in rows] == [[world, limit] for world in worlds for limit in ("15", "30")]
    assert all(0.0 < float(cell.split()[0]) < 20.0 for row in rows for cell in row[2:5])
    later = ["--episodes", "4", "--newtons", "15", "--version", "1", "--worlds", "Instrument"]
    tension_limit.main([*later, "--picture", str(tmp_path / "limits.png")])
    assert (tmp_path / "limits.png").read_bytes().startswith(b"\x89PNG")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in capsys.readouterr().out.splitlines()[2:]]
    assert [row[1] for row in rows] == ["15", "drawn"]
    assert all(0.0 < float(cell.split()[0]) < 20.0 for row in rows for cell in row[3:6])


@pytest.mark.slow  # alone it loads torch, compiled solvers and the search
def test_throughput_is_of_all_designs(monkeypatch):
    import throughput

    from agents.executors.options import executor_of

    monkeypatch.setattr(throughput, "executor_of", lambda cluster, jobs: executor_of(cluster, jobs, inline=True))
    searched = throughput.search
    budgets = []

    def counted(executor, home, config):
        searched(executor, home, config)
        budgets.append(sum(run.evaluations for run in map(throughput.SearchRun, home.path.glob("*/*/"))))

    monkeypatch.setattr(throughput, "search", counted)
    ((what, workers, wall, rate, times),) = throughput.rows_of("x", throughput.chunks, 500, "local", [1])
    assert (what, workers, times) == ("x", "1", "1.00") and float(wall) >= 0 < float(rate.replace(",", ""))
    assert budgets == [400, 500]  # those that only have the workers begin are not timed


def test_a_chunk_takes_time_with_and_without_gradients():
    import throughput

    name, alone, gradients = throughput.chunk_times("bending_shapes", 1)
    assert name == "bending_shapes" and int(alone) > 0 < int(gradients)


def test_environments_of_tensors_are_measured_on_a_device_that_is_named(capsys):
    import torch_env

    torch_env.main(["--device", "cpu", "--id", "rj_gym/LatePose-v0", "--lanes", "4", "8", "--repeats", "2"])
    text = capsys.readouterr().out
    assert text.startswith("Device: CPU, ") and "steps/s, native (CPU)" in text and "rj_gym/LatePose-v0" in text
    rows = [
        [float(cell.replace(",", "")) for cell in line.split("|")[1:-1]]
        for line in text.splitlines()
        if "| 4 |" in line or "| 8 |" in line
    ]
    assert [row[0] for row in rows] == [4, 8, 4, 8]
    assert all(rate > 0.0 for row in rows for rate in row[1:4]) and all(0.0 <= row[4] <= 100.0 for row in rows[:2])


def test_larger_numbers_of_lanes_are_left_out_where_one_takes_too_long(capsys):
    import torch_env

    torch_env.main(["--device", "cpu", "--lanes", "2", "3", "--repeats", "1", "--limit", "0"])
    text = capsys.readouterr().out
    assert text.count("2 took longer than 0 s: larger ones are left out") == 2
    assert "\n| 2 |" in text and "\n| 3 |" not in text  # a slow machine may have 3 solves/s


def test_the_driver_hands_every_unit_to_sleeping_workers():
    import scaling

    mean, wall, busy, rate, *_ = scaling.simulated(200, 50, 0.02)
    assert mean == "0.02" and float(wall) >= 0.1  # 200 units of 0.02 s for 50 workers take 0.08 s, the last ones longer
    assert 0 < float(busy.removesuffix(" %")) <= 100 and float(rate.replace(",", "")) > 0
    assert min(scaling.recorded_seconds()) > 0


@pytest.mark.slow  # compiles a kernel that nothing else needs
def test_gaps_through_vectors_are_those_that_are_written_out(monkeypatch, capsys):
    import vectors

    monkeypatch.setattr(vectors, "PAIRS", 2)
    monkeypatch.setattr(vectors, "ROUNDS", 100)
    vectors.main()
    assert capsys.readouterr().out.endswith("equal to the last bit: yes\n")


def test_kernels_own_source_gives_what_is_written_for_tensors():
    import one_source

    case = one_source.Case(7)
    for one, other in zip(case.shared_by(one_source.SharedSource()), case.written_for_tensors(), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)


def test_solves_and_gradients_of_tensors_are_timed():
    import tensors

    times = tensors.measured((2,))
    assert len(times) == 5 and min(times.values()) > 0.0
