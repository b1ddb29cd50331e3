"""The environments of tensors are the native ones: the same episodes, numbers to 1e-9, ends and refusals."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import rj_gym
from rollingjoint import InvalidInput, Status, five_link

torch = pytest.importorskip("torch")

from rj_gym.torch_env import TorchTrackingEnv  # noqa: E402 - needs torch
from rollingjoint.differentiable import as_on_a_device  # noqa: E402
from tests.host_reads import no_host_reads  # noqa: E402
from tests.rj_gym.watched_solver import watch_solver  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_torch_thread")

PLAIN, GOAL = "rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0"
EQUAL = 1e-9  # mm, N, mm of commands
MISMATCH = {"stiffness_spread": 0.2, "actuator_offset_mm": 0.5}
WORLDS = {
    "fixed target": (PLAIN, {}),
    "goals": (GOAL, {}),
    "sparse goals": (GOAL, {"reward": {"goal": "sparse", "goal_tolerance_mm": 20.0}}),
    "moving target, stepping load": (PLAIN, {"target": {"process": "path"}, "load": {"process": "step"}}),
    "drifting load, observed": (
        PLAIN,
        {"load": {"process": "ou", "link": "tip", "correlation_steps": 6.0}, "observe_load": True},
    ),
    "noise, other tendons": (PLAIN, {"randomization": {"position_noise_mm": 0.3, "angle_noise_rad": 0.01} | MISMATCH}),
    "other surfaces": (PLAIN, {"randomization": {"link_tolerance_mm": 0.2, "link_tolerance_rad": 0.02}}),
    "ends of surfaces": (PLAIN, {"load": {"magnitude": (5.0, 12.0)}, "action_scale_mm": 4.0}),
    "loaded targets, few readings": (PLAIN, {"target": {"loaded": True}, "observe_tensions": False}),
    "other rewards": (PLAIN, {"reward": {"precision": 0.5, "effort": 0.3}, "start": "random"}),
    "four tendons": (PLAIN, {"mechanism": "two_segment"}),
    "other numbers": (
        PLAIN,
        {
            "tension_range": (0.8, 9.0),
            "start_tension": 2.5,
            "command_scale_mm": 15.0,
            "target": {"process": "path", "waypoints": 4, "tension_range": (1.5, 5.0)},
            "load": {"process": "step", "hold_steps": 4.0},
            "reward": {"smoothness": 0.2, "failure_penalty": 7.0},
        },
    ),
    "other starts": (PLAIN, {"start": "random", "start_tension_range": (2.0, 4.0)}),
}
SHORT = {"episode_steps": 12}
QUICK = ("fixed target", "goals", "other surfaces")
INSTRUMENTS = {
    "instrument": ("rj_gym/Instrument-v0", {"autoreset_mode": "SameStep"}),
    "instrument before it wears": ("rj_gym/InstrumentShift-v0", {"observe_history": 3}),
    "slow camera": ("rj_gym/SlowCamera-v0", {"privileged": "info"}),
    "late pose": ("rj_gym/LatePose-v0", {"privileged": "observation", "autoreset_mode": "SameStep"}),
    "a tip badly seen": (
        PLAIN,
        {
            "sensing": {
                "pose": "tip",
                "period": 3,
                "position_bias_mm": 2.0,
                "angle_bias_rad": 0.1,
                "encoder_noise_mm": 0.1,
                "encoder_resolution_mm": 0.03,
                "tension_noise": 2.0,
                "tension_resolution": 0.05,
            },
            "observe_load": True,
            "observe_history": [1, 4],
        },
    ),
    "motors of a rig": ("rj_gym/Instrument-v1", {"autoreset_mode": "SameStep"}),
    "motors of a rig, pictures": ("rj_gym/SlowCamera-v1", {"privileged": "info"}),
    "weak motors": (
        "rj_gym/LatePose-v1",
        {"actuation": {"tension_limit": (3.2, 6.0), "current_resolution": 0.5}, "privileged": "observation"},
    ),
    "limits of tendons": (
        "rj_gym/Instrument-v0",
        {
            "actuation": {"tension_limit": (4.0, 9.0), "dead_band_mm": 0.1},
            "sensing": {"tension_at": "tendon", "tension_gain_error": 0.1, "tension_offset": 0.4},
        },
    ),
    "slow motors": (
        PLAIN,
        {
            "actuation": {"rate_limit_mm": 0.4, "delay": 2, "play_mm": 1.0},
            "load": {"process": "ou", "magnitude": (3.0, 8.0)},
            "sensing": {"delay": 9},
            "observe_tensions": False,
            "reward": {"error_scale_mm": 0.5},
            "privileged": "info",
        },
    ),
    "four hidden tendons": (
        PLAIN,
        {
            "mechanism": "two_segment",
            "sensing": {"pose": "none"},
            "actuation": {"sheath_friction": 0.3, "play_mm": (0.0, 1.0)},
            "observe_history": 2,
            "observe_load": True,
        },
    ),
}


def pair(env_id=PLAIN, lanes=6, **settings):
    """The environment of tensors, and the native one."""
    native = gymnasium.make_vec(env_id, lanes, "vector_entry_point", **settings)
    return TorchTrackingEnv(env_id, lanes, **settings), native


def assert_equal(ours, native, where=""):
    """Nested results: the same entries, shapes and types; floats of 64 bits to EQUAL, others to rounding."""
    if isinstance(native, dict):
        names = {key for key in native if key.removeprefix("_") != "mechanism"}
        assert set(ours) == names, where
        for key in names:
            assert_equal(ours[key], native[key], f"{where}/{key}")
        return
    if where.endswith("/status"):
        native = np.array([Status[name] if name else 0 for name in native], np.int64)
    if where.endswith("/final_obs"):
        return  # test_last_observations_are_those_of_the_native_environment
    numbers = ours.numpy()
    assert (numbers.shape, numbers.dtype) == (np.shape(native), native.dtype), where
    if where.endswith("/privileged"):
        numbers, native = with_comparable_rates(numbers, native)
    limit = 2e-6 if native.dtype == np.float32 else EQUAL
    np.testing.assert_allclose(numbers, native, rtol=limit, atol=limit, err_msg=where)


def with_comparable_rates(ours, native):
    """Privileged states of two tendons, without some tip rates.

    Where a tendon is at a limit, rounding chooses their side; and the compiled general solver, which the device
    needs less often than the native environment, leaves zeros.
    """
    tensions, (low, high) = 15.0 * native[:, -11:-9], (0.5, 15.0)
    at_limit = (np.abs(tensions - low) < 1e-5) | (np.abs(tensions - high) < 1e-5)  # of 32 bits
    left_out = at_limit.any(-1) | (native[:, -4:] == 0.0).all(-1)
    assert left_out.mean() < 1.0
    ours, native = ours.copy(), native.copy()
    for states in (ours, native):
        states[left_out, -4:] = 0.0
    return ours, native


def played(ours, native, seed, steps, largest=1.2):
    """Both through the same episodes; every result has to be the same. Returns all statuses."""
    rng, statuses = np.random.default_rng(seed), []
    for one, other in zip(ours.reset(seed=seed), native.reset(seed=seed), strict=True):
        assert_equal(one, other, "reset")
    for step in range(steps):
        actions = rng.uniform(-largest, largest, native.action_space.shape).astype(np.float32)
        result = ours.step(torch.tensor(actions))
        for one, other in zip(result, native.step(actions), strict=True):
            assert_equal(one, other, f"step {step}")
        statuses += result[4]["status"].tolist()
    return statuses


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("world", QUICK)
def test_episodes_are_those_of_the_native_environment(world, mode):
    env_id, settings = WORLDS[world]
    played(*pair(env_id, episode_steps=3, autoreset_mode=mode, **settings), seed=3, steps=8)


@pytest.mark.slow
@pytest.mark.parametrize("world", INSTRUMENTS)
def test_what_motors_and_sensors_do_is_that_of_the_native_environment(world):
    env_id, settings = INSTRUMENTS[world]
    played(*pair(env_id, lanes=4, episode_steps=9, **settings), seed=1, steps=21)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("world", WORLDS | INSTRUMENTS)
def test_long_episodes_are_those_of_the_native_environment(world, mode):
    env_id, settings = (WORLDS | INSTRUMENTS)[world]
    ours, native = pair(env_id, lanes=48, **SHORT, **settings | {"autoreset_mode": mode})
    for seed in (0, 11):
        statuses = played(ours, native, seed, steps=30)
    assert ours.host_solves < 30 * 2 * 48
    if world == "ends of surfaces":
        assert {Status.AT_LIMIT, Status.CONVERGED} <= set(statuses)


@pytest.mark.slow
def test_lanes_that_the_device_leaves_to_the_host_are_those_of_the_native_environment():
    ours, native = pair(lanes=32, action_scale_mm=8.0, load={"magnitude": (3.0, 8.0)}, episode_steps=10)
    played(ours, native, 5, 20)
    assert ours.host_solves > 32


def test_last_observations_are_those_of_the_native_environment():
    ours, native = pair(GOAL, lanes=3, episode_steps=2, autoreset_mode="SameStep")
    ours.reset(seed=0), native.reset(seed=0)
    for _ in range(2):
        one, other = ours.step(torch.full((3, 2), 0.3))[4], native.step(np.full((3, 2), 0.3))[4]
    assert one["_final_obs"].tolist() == other["_final_obs"].tolist() == [True] * 3
    for lane, last in enumerate(other["final_obs"]):
        for key, values in last.items():
            np.testing.assert_allclose(one["final_obs"][key][lane].numpy(), values, rtol=0, atol=2e-6)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("world", ["fixed target", "slow camera"])
def test_a_failed_solve_ends_its_lane_as_in_the_native_environment(world, mode):
    env_id, settings = (WORLDS | INSTRUMENTS)[world]
    ours, native = pair(env_id, lanes=3, autoreset_mode=mode, reward={"failure_penalty": 7.3}, **settings)
    ours.reset(seed=0), native.reset(seed=0)
    buffer, host, solve = native.unwrapped._buffer, ours._host, ours._solver.solve
    watch_solver(buffer, after=lambda: buffer.solver.results.status.put(1, Status.NOT_CONVERGED))
    solve_alone = host.solver.alone
    host.solver.alone = lambda *rows: (solve_alone(*rows), host.solver.results.status.put(1, Status.NOT_CONVERGED))
    others = torch.tensor([True, False, True])
    ours._solver.solve = lambda *inputs: (found := solve(*inputs))._replace(arrived=found.arrived & others)
    ended = []
    for step in range(4):
        actions = np.full((3, 2), 0.1 * (step + 1), np.float32)
        result = ours.step(torch.tensor(actions))
        for one, other in zip(result, native.step(actions), strict=True):
            assert_equal(one, other, f"step {step}")
        ended.append(result[2].tolist())
    assert ended[0] == [False, True, False]
    assert [row[1] for row in ended] == ([True] * 4 if mode == "SameStep" else [True, False, True, False])


def test_episodes_of_one_step_begin_anew_at_every_other_one():
    played(*pair(lanes=3, episode_steps=1), seed=0, steps=5)
    played(*pair(lanes=3, episode_steps=1, autoreset_mode="SameStep"), seed=0, steps=5)


def test_masked_resets_are_those_of_the_native_environment():
    ours, native = pair(lanes=4, episode_steps=3, autoreset_mode="Disabled")
    played(ours, native, seed=2, steps=2)
    mask = np.array([True, False, True, False])
    options = {"target": np.array([5.0, 90.0]), "load": {"link": -1, "force": np.array([0.2, 0.1])}}
    for one, other in zip(
        ours.reset(seed=9, options={"reset_mask": torch.tensor(mask), **options}),
        native.reset(seed=9, options={"reset_mask": mask, **options}),
        strict=True,
    ):
        assert_equal(one, other, "masked")
    for one, other in zip(ours.step(torch.ones(4, 2)), native.step(np.ones((4, 2), np.float32)), strict=True):
        assert_equal(one, other, "after it")
    assert ours._steps.tolist() == [1, 3, 1, 3]
    with pytest.raises(ResetNeeded, match=r"Lanes \[1, 3\] have ended"):
        ours.step(torch.zeros(4, 2))


def test_a_series_of_targets_and_another_mechanism_can_be_held():
    ours, native = pair(lanes=3, episode_steps=3)
    ours.reset(seed=0), native.reset(seed=0)
    path = np.linspace([0.0, 95.0], [20.0, 90.0], 4)
    stiffer = five_link().replace(tendons=tuple(_stiffer(tendon) for tendon in five_link().tendons))
    for options in ({"target": path}, {"mechanism": stiffer}, {}):
        for one, other in zip(
            ours.reset(options=options | {"reset_mask": np.array([True, True, False])}),
            native.reset(options=options | {"reset_mask": np.array([True, True, False])}),
            strict=True,
        ):
            assert_equal(one, other, str(options))
        for one, other in zip(ours.step(torch.ones(3, 2)), native.step(np.ones((3, 2))), strict=True):
            assert_equal(one, other, str(options))


def _stiffer(tendon):
    from dataclasses import replace

    return replace(tendon, stiffness=2.0 * tendon.stiffness)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_actions_that_are_not_finite_are_refused_and_change_nothing(bad):
    ours, native = pair(lanes=2)
    played(ours, native, seed=0, steps=1)
    with pytest.raises(InvalidInput, match=r"actions = .*expected finite numbers in \[-1, 1\] of shape \(2, 2\)"):
        ours.step(torch.tensor([[0.0, bad], [0.0, 0.0]]))
    for one, other in zip(ours.step(torch.zeros(2, 2)), native.step(np.zeros((2, 2))), strict=True):
        assert_equal(one, other, "afterwards")


@pytest.mark.parametrize("actions", [torch.zeros(2), torch.zeros(3, 2), "up"])
def test_actions_of_another_shape_are_refused(actions):
    env = TorchTrackingEnv(PLAIN, 2)
    env.reset(seed=0)
    with pytest.raises(InvalidInput, match="finite numbers"):
        env.step(actions)


def test_a_step_needs_a_reset():
    with pytest.raises(ResetNeeded):
        TorchTrackingEnv().step(torch.zeros(1, 2))


@pytest.mark.parametrize("world", ["fixed target", "slow camera", "late pose"])
def test_a_step_reads_nothing_back_but_its_report(world):
    env_id, settings = (WORLDS | INSTRUMENTS)[world]
    env = TorchTrackingEnv(env_id, 8, load={"magnitude": (0.0, 0.1)}, action_scale_mm=0.2, **settings)
    env.reset(seed=0)
    with as_on_a_device(), no_host_reads():
        for _ in range(3):
            env.step(torch.full((8, 2), 0.3))
    assert env.host_solves == 0


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_a_step_on_a_cuda_device_waits_once():
    env = TorchTrackingEnv(PLAIN, 8, "cuda", load={"magnitude": (0.0, 0.1)}, action_scale_mm=0.2)
    env.reset(seed=0)
    actions = torch.full((8, 2), 0.3, device="cuda")
    env.step(actions)
    with pytest.warns(UserWarning, match="synchronizing") as waits:
        torch.cuda.set_sync_debug_mode("warn")
        env.step(actions)
        torch.cuda.set_sync_debug_mode("default")
    assert len(waits) == 1


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("env_id", [PLAIN, "rj_gym/SlowCamera-v0", "rj_gym/LatePose-v0"])
def test_numbers_on_a_cuda_device_are_those_of_the_native_environment(env_id):
    _, native = pair(env_id, lanes=16, episode_steps=5)
    ours = TorchTrackingEnv(env_id, 16, "cuda", episode_steps=5)
    ours.reset(seed=0), native.reset(seed=0)
    for _ in range(12):
        one, other = ours.step(torch.full((16, 2), 0.5, device="cuda")), native.step(np.full((16, 2), 0.5))
        assert one[0].is_cuda
        np.testing.assert_allclose(one[4]["tip"].cpu().numpy(), other[4]["tip"], rtol=0, atol=EQUAL)
        np.testing.assert_allclose(one[1].cpu().numpy(), other[1], rtol=0, atol=EQUAL)


def test_gymnasium_converts_its_tensors():
    pytest.importorskip("array_api_compat")
    wrappers = pytest.importorskip("gymnasium.wrappers.vector")
    if not hasattr(wrappers, "ArrayConversion"):
        pytest.skip("Gymnasium 1.2 and later have it")
    import array_api_compat.numpy
    import array_api_compat.torch

    ours, native = pair(lanes=3, episode_steps=2)
    env = wrappers.ArrayConversion(ours, array_api_compat.torch, array_api_compat.numpy)
    observations, infos = env.reset(seed=4)
    assert isinstance(observations, np.ndarray) and isinstance(infos["sampled"]["targets"], np.ndarray)
    np.testing.assert_allclose(observations, native.reset(seed=4)[0], rtol=0, atol=2e-6)
    for _ in range(4):
        one, other = env.step(np.full((3, 2), 0.4, np.float32)), native.step(np.full((3, 2), 0.4, np.float32))
        np.testing.assert_allclose(one[1], other[1], rtol=0, atol=EQUAL)
        assert one[3].tolist() == other[3].tolist() and isinstance(one[4]["error_mm"], np.ndarray)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_with_converted_arrays_it_keeps_the_contract_of_vector_environments(mode):
    pytest.importorskip("array_api_compat")
    wrappers = pytest.importorskip("gymnasium.wrappers.vector")
    if not hasattr(wrappers, "ArrayConversion"):
        pytest.skip("Gymnasium 1.2 and later have it")
    import array_api_compat.numpy
    import array_api_compat.torch

    def converted():
        env = TorchTrackingEnv(PLAIN, 3, episode_steps=4, autoreset_mode=mode)
        return wrappers.ArrayConversion(env, array_api_compat.torch, array_api_compat.numpy)

    one_tensor = {"hands_over_final_obs_and_final_info": "final_obs is one tensor, no array of objects"}
    skip = one_tensor if mode == "SameStep" else {}
    rj_gym.check_vector_env(converted, max_episode_steps=4, n_steps=30, skip=skip)


@pytest.mark.parametrize("env_id", [PLAIN, "rj_gym/SlowCamera-v0"])
def test_a_pickled_copy_goes_on_with_the_same_numbers(env_id):
    env = TorchTrackingEnv(env_id, 3, episode_steps=3, randomization={"link_tolerance_mm": 0.2})
    env.reset(seed=0), env.step(torch.full((3, 2), 0.3))
    copy = pickle.loads(pickle.dumps(env))
    for _ in range(5):
        one, other = env.step(torch.full((3, 2), -0.4)), copy.step(torch.full((3, 2), -0.4))
        assert torch.equal(one[0], other[0]) and torch.equal(one[1], other[1])


def test_what_a_caller_does_to_results_changes_no_episode():
    ours, native = pair(lanes=2)
    played(ours, native, seed=0, steps=1)
    for values in ours.step(torch.zeros(2, 2))[4].values():
        if isinstance(values, torch.Tensor) and values.is_floating_point():
            values.fill_(99.0)
    native.step(np.zeros((2, 2)))
    for one, other in zip(ours.step(torch.zeros(2, 2)), native.step(np.zeros((2, 2))), strict=True):
        assert_equal(one, other, "afterwards")


@pytest.mark.slow
def test_without_torch_the_extra_is_named(run_python):
    hidden = "import sys; sys.modules['torch'] = None\n"
    program = "try:\n    import rj_gym.torch_env\nexcept ModuleNotFoundError as error:\n    print(error)"
    assert run_python("-c", hidden + program) == 'torch is not installed: run pip install "rollingjoint[design]"\n'
