"""Scripts that name controllers as they were called before go on working."""

import pickle
import subprocess
import sys

import pytest

import agents.baselines
from agents import controllers


def test_classes_are_the_same_under_the_former_name():
    from agents.baselines.open_loop import OpenLoop

    assert agents.baselines.OpenLoop is OpenLoop is controllers.OpenLoop
    assert isinstance(pickle.loads(pickle.dumps(OpenLoop(), 0).replace(b"controllers", b"baselines")), OpenLoop)


@pytest.mark.slow
def test_the_command_runs_under_the_former_name():
    command = [sys.executable, "-m", "agents.baselines.tune", "--help"]
    assert "--world" in subprocess.run(command, capture_output=True, text=True, check=True).stdout
