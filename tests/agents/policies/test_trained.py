"""The policy of a run as a controller with NumPy alone: it acts as the model does, and its file says all of it."""

import gymnasium
import numpy as np
import pytest

from agents.controllers.controller import Reading
from agents.controllers.policy import Policy
from agents.controllers.residual import controller_of
from agents.evaluation.rollout import run_episodes
from agents.policies.errors import PolicyError
from agents.policies.file import pack, unpack
from agents.policies.parameters import parameters_of
from agents.policies.trained import KEYS, TrainedPolicy, load_trained, policy_of
from agents.runs.config import TrainConfig
from agents.runs.files import RunFolderError, hash_file, write_bytes
from agents.runs.folder import PolicyFiles, RunFolder
from agents.training.build import build_model, close
from agents.training.checkpoint import save_policy

FLAT, GOAL, INSTRUMENT = "rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0", "rj_gym/Instrument-v0"
OFF_POLICY = {"buffer_size": 1000, "learning_starts": 40}
ALL = {
    "ppo": {},
    "sac": {"algorithm": "sac", "parameters": OFF_POLICY},
    "sac with state-dependent exploration": {"algorithm": "sac", "parameters": {**OFF_POLICY, "use_sde": True}},
    "tqc": {"algorithm": "tqc", "parameters": OFF_POLICY},
    "crossq": {"algorithm": "crossq", "parameters": OFF_POLICY},
    "hindsight": {"algorithm": "sac", "parameters": OFF_POLICY, "her": {}, "env": {"id": GOAL}},
    "recurrent ppo": {"algorithm": "recurrent_ppo", "policy": {"memory": 6, "hidden": [8]}},
    "apg": {"algorithm": "apg", "policy": {"memory": 6}, "env": {"id": INSTRUMENT}},
    "distill": {"algorithm": "distill", "policy": {"memory": 6}, "env": {"id": INSTRUMENT}},
    "privileged critic": {"policy": {"critic": "privileged", "hidden": [8]}, "env": {"id": INSTRUMENT}},
    "residual": {"residual": "open loop", "env": {"id": INSTRUMENT}},
    "design": {"env": {"id": "rj_gym/CurvatureDesign-v0"}},
    "without normaliser": {"normalise": {"observation": False, "reward": False}},
}


def config(changes) -> TrainConfig:
    env = {"id": FLAT, "n_envs": 2, **changes.get("env", {})}
    steps = {} if "Design" in env["id"] else {"settings": {"episode_steps": 4}}
    return TrainConfig.from_dict({"policy": {"hidden": [8]}, **changes, "env": {**env, **steps}})


def seen_by(model, rng) -> Reading:
    """What an environment could show, without what only a critic sees."""

    def some(space):
        return rng.normal(size=(2, *space.shape)).astype(np.float32)

    space = model.observation_space
    if not isinstance(space, gymnasium.spaces.Dict):
        return Reading(some(space))
    parts = {key: some(part) for key, part in space.spaces.items()}
    return Reading(parts if "desired_goal" in parts else parts["observation"])


def statistics_of(normaliser) -> list:
    """The running means of all that is normalised."""
    running = normaliser.obs_rms if normaliser is not None and normaliser.norm_obs else {}
    return list(running.values()) if isinstance(running, dict) else [running]


@pytest.mark.parametrize("changes", ALL.values(), ids=ALL)
def test_policy_of_every_learner_acts_as_its_model_and_is_the_same_from_its_file(changes):
    model = build_model(config(changes))
    normaliser, rng = model.get_vec_normalize_env(), np.random.default_rng(0)
    for running in statistics_of(normaliser):
        running.update(rng.normal(0.3, 2.0, (50, *running.mean.shape)))
    ours, theirs = policy_of(model, normaliser), Policy(model, normaliser)
    again = TrainedPolicy.from_bytes(ours.to_bytes())
    for each in (ours, theirs, again):
        each.begin(None, 2)
    for _ in range(3):
        seen = seen_by(model, rng)
        actions = ours.act(seen)
        np.testing.assert_allclose(actions, theirs.act(seen), atol=2e-6)
        np.testing.assert_array_equal(again.act(seen), actions)
    assert (again.algorithm, again.steps) == (changes.get("algorithm", "ppo"), model.num_timesteps)
    assert again.observations == ours.observations == pytest.approx(0 if "normalise" in changes else 50, abs=0.01)
    close(model)


def test_residual_policy_drives_on_top_of_its_guide_after_loading(tmp_path):
    settings = config(ALL["residual"])
    run, model = RunFolder.create(tmp_path / "run", settings, []), build_model(settings)
    save_policy(model, run.policy_files("best"))
    close(model)
    errors = [
        run_episodes(settings.env, controller_of(settings, policy), [3, 4]).errors
        for policy in (policy_of(model, model.get_vec_normalize_env()), load_trained(run))
    ]
    np.testing.assert_array_equal(*errors)


class Grid(gymnasium.Env):
    """Observations with rows and columns, which have no form in NumPy."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2, 3))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros((2, 3), np.float32), {"error_mm": 1.0}

    def step(self, action):
        return np.zeros((2, 3), np.float32), 0.0, False, True, {"error_mm": 1.0}


@pytest.fixture
def grid():
    gymnasium.register("test/Grid-v0", Grid)
    yield TrainConfig.from_dict({"policy": {"hidden": [8]}, "env": {"id": "test/Grid-v0", "n_envs": 2}})
    gymnasium.registry.pop("test/Grid-v0")


def test_policy_without_a_form_in_numpy_acts_as_in_training_and_needs_no_pickle(grid, tmp_path):
    run, model = RunFolder.create(tmp_path / "run", grid, []), build_model(grid)
    files, observations = run.policy_files("best"), np.random.default_rng(1).normal(size=(4, 2, 3)).astype(np.float32)
    save_policy(build_model(config({})), files)
    assert files.network.is_file()
    model.get_vec_normalize_env().obs_rms.update(3.0 + 2.0 * observations)
    save_policy(model, files)  # which leaves nothing of the one before
    assert not files.network.is_file()
    files.model.write_bytes(b"no zip")
    files.normaliser.unlink()
    hash_file(files.normaliser).unlink()
    hash_file(files.model).unlink()
    policy = load_trained(run)
    assert isinstance(policy, Policy)
    expected = Policy(model, model.get_vec_normalize_env()).act(observations)
    assert np.array_equal(policy.act(observations), expected) and expected.any()
    close(model)


def test_parameters_of_another_policy_are_refused_in_one_line(grid, tmp_path):
    run, other = RunFolder.create(tmp_path / "run", grid, []), build_model(config({}))
    files = run.policy_files("best")
    write_bytes(files.parameters, parameters_of(other, None))
    with pytest.raises(
        RunFolderError, match=r"policy.parameters.safetensors.*expected parameters of the policy"
    ) as refused:
        load_trained(run)
    assert "\n" not in str(refused.value)
    close(other)


@pytest.mark.parametrize("key", KEYS)
def test_file_that_says_less_is_refused_in_one_line(key, tmp_path):
    model = build_model(config({}))
    content, tensors = unpack(policy_of(model).to_bytes(), "")
    content.pop(key)
    with pytest.raises(PolicyError, match=rf"run/policy.safetensors: .*{key}") as refused:
        TrainedPolicy.from_bytes(pack(content, tensors), "run/policy.safetensors")
    assert "\n" not in str(refused.value)
    close(model)


def test_files_of_a_policy_lie_beside_each_other(tmp_path):
    assert {path.parent for path in PolicyFiles.within(tmp_path)} == {tmp_path}
    assert not PolicyFiles.within(tmp_path).are_there
