"""What tests of the learners share: lanes, and what every learner is held to."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import pytest
import torch
from gymnasium.vector import AutoresetMode

from agents import train
from agents.learners.tape import StepTape
from agents.policies.export import check_against_torch, export_policy
from agents.runs.config import TrainConfig
from agents.training.build import build_model, close
from agents.training.callbacks import Evaluator
from agents.training.learn import learn
from rollingjoint.checked_yaml import dump_yaml
from tests.agents.training.test_resume import weights


@dataclass(frozen=True)
class Player:
    """An actor whose step is a function of observations and memory, with these parameters."""

    step: Callable[[torch.Tensor, torch.Tensor | None], tuple[torch.Tensor, torch.Tensor]]
    weights: tuple[torch.Tensor, ...] = ()

    def parameters(self) -> tuple[torch.Tensor, ...]:
        return self.weights

    def tape(self, steps: int, lanes: int) -> StepTape:
        return StepTape(self)


def lanes_of(env_id: str, count: int, **overrides: Any) -> Any:
    """A native vector environment whose episodes are begun by hand."""
    return gymnasium.make_vec(
        env_id, count, "vector_entry_point", autoreset_mode=AutoresetMode.DISABLED, **overrides
    ).unwrapped


def check_that_numpy_acts_as_torch(config: TrainConfig) -> None:
    """Over whole episodes, after a little training, with actions large enough to differ from each other."""
    model = build_model(config)
    learn(model, config, [])
    model.policy.actor.head[-1].weight.data.mul_(30)
    normaliser = model.get_vec_normalize_env()
    training = {"config": {}, "steps": 0, "seed": 0, "versions": {}}
    policy = export_policy(model, normaliser, config.env, "own", training)
    assert policy.algorithm == config.algorithm and policy.has_memory
    assert 0 < check_against_torch(policy, model, normaliser) < 1e-5
    close(model)


def check_that_a_stopped_run_ends_with_the_same_weights(
    values: Mapping[str, Any], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped by a signal at its first evaluation and resumed, beside one that was not."""
    (folder / "run.yaml").write_text(dump_yaml(values))
    begin = ["--config", str(folder / "run.yaml"), "--run-dir"]
    assert train.main([*begin, str(folder / "whole")]) == 0
    evaluation = Evaluator.evaluate
    with monkeypatch.context() as patch:
        patch.setattr(Evaluator, "evaluate", lambda self: signal.raise_signal(signal.SIGTERM) or evaluation(self))
        assert train.main([*begin, str(folder / "stopped")]) == 128 + signal.SIGTERM
    assert train.main(["--resume", str(folder / "stopped")]) == 0
    assert weights(folder / "stopped") == weights(folder / "whole")
