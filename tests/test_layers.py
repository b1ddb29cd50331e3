"""Imports stay light; what imports what is a matter of import-linter's contracts in pyproject.toml."""

import pytest

LEARNING = ["torch", "stable_baselines3", "tensorboard"]
DRAWING = ["matplotlib", "pygame", "PIL"]

STEP = """
import gymnasium, rj_gym
env = gymnasium.make("rj_gym/RollingJoint-v0")
env.reset(seed=0)
assert env.observation_space.contains(env.step(env.action_space.sample())[0])
"""
SOLVE = """
import rollingjoint
assert rollingjoint.solve_tensions(rollingjoint.five_link(), (1.0, 1.0)).ok
"""


@pytest.mark.slow
@pytest.mark.parametrize("package", ["rollingjoint", "rj_gym"])
def test_import_loads_no_learning_or_drawing_package(package, run_python):
    loaded = run_python("-c", f"import sys, {package}; print(*sys.modules)").split()
    assert package in loaded
    assert not set(loaded) & {*LEARNING, *DRAWING}


def test_import_of_physics_loads_no_gymnasium(run_python):
    assert "gymnasium" not in run_python("-c", "import sys, rollingjoint; print(*sys.modules)").split()


@pytest.mark.slow
@pytest.mark.parametrize("program", [SOLVE, STEP], ids=["solve", "step"])
def test_physics_and_environment_work_without_learning_and_drawing_packages(program, run_python):
    hide = f"import sys; sys.modules.update(dict.fromkeys({LEARNING + DRAWING}))"  # None makes an import fail
    run_python("-c", f"{hide}\n{program}")


@pytest.mark.slow
def test_registration_survives_a_second_import(run_python):
    run_python("-W", "error::UserWarning", "-c", "import importlib, rj_gym; importlib.reload(rj_gym)")
