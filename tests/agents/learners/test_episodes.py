"""Gradients through episodes are the derivatives of the environment's own errors."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode

from agents.learners.episodes import DifferentiableEpisodes
from agents.learners.feed_forward import FeedForwardActor
from agents.learners.motion import MotionTape, Motors, Readings
from agents.learners.recurrent import RecurrentActor
from agents.learners.tape import StepTape, Tape
from rj_gym.core.task import ObservedError
from tests.agents.learners.checks import Player

STEPS, LANES = 12, 6
WORLDS: dict[str, tuple[str, dict[str, Any]]] = {
    "instrument": ("rj_gym/Instrument-v0", {"observe_history": [1, 3]}),
    "late and slow motors": (
        "rj_gym/Instrument-v0",
        {"actuation": {"play_mm": (0.1, 0.4), "rate_limit_mm": 0.7, "delay": 2}},
    ),
    "motors with limits": (
        "rj_gym/Instrument-v0",
        {
            "start": "measured",
            "sensing": {"tension_gain_error": 0.1, "tension_offset": 0.2},
            "actuation": {"play_mm": (0.5, 1.0), "tension_limit": (3.5, 5.0), "limit_at": "motor"},
        },
    ),
    "motors with limits and dead bands": (
        "rj_gym/Instrument-v0",
        {
            "sensing": {"tension_at": "tendon"},
            "actuation": {
                "play_mm": (0.5, 1.0),
                "tension_limit": (3.5, 5.0),
                "limit_at": "motor",
                "dead_band_mm": 0.2,
                "rate_limit_mm": 0.7,
            },
        },
    ),
    "links seen late": ("rj_gym/LatePose-v0", {}),
    "links seen now and then": ("rj_gym/SlowCamera-v0", {}),
    "tip seen late": ("rj_gym/LatePose-v0", {"sensing": {"pose": "tip"}, "observe_history": 2}),
    "without motors of their own": ("rj_gym/RollingJoint-v0", {"sensing": {"pose": "tip"}, "observe_history": 1}),
    "arm": ("rj_gym/FlexibleArm-v0", {}),
    "arm's instrument without friction in its holes, away from tension limits": (
        "rj_gym/ArmInstrument-v0",
        {"observe_history": 1, "friction": {"mu": 0.0}, "start_tension": 20.0, "tension_range": (0.5, 100.0)},
    ),
}


@pytest.fixture(params=WORLDS, scope="module")
def world(request: pytest.FixtureRequest) -> Any:
    """A vector environment."""
    env_id, settings = WORLDS[request.param]
    env = gymnasium.make_vec(
        env_id, LANES, "vector_entry_point", episode_steps=STEPS, autoreset_mode=AutoresetMode.DISABLED, **settings
    )
    yield env
    env.close()


def _loss(env: Any, weights: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """Mean error of the last steps of a policy that is linear in what it sees and in a memory of it."""
    env.reset(seed=3)

    def act(x: torch.Tensor, memory: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        memory = 0.5 * x + (0.0 if memory is None else 0.5 * memory)
        return memory @ weights + bias, memory

    # Poses are in units of the mechanism's length: a policy has to look at them closely to use them.
    task = env.unwrapped.task
    scale = np.array([0.5 if entry.name in task.pictured else 1.0 for entry in task.entries()])
    episodes = DifferentiableEpisodes(env, lambda seen: (np.zeros(len(scale)), scale))
    played = episodes.play(Player(act, (weights, bias)))
    assert played is not None
    return played.errors[-4:].mean()


@pytest.mark.slow
def test_gradients_are_those_of_the_environment(world: Any) -> None:
    """Of the loss by every kind of parameter, against central differences of whole episodes."""
    rng, m = np.random.default_rng(0), world.single_action_space.shape[0]
    count = world.single_observation_space.shape[0]
    weights = torch.tensor(0.15 * rng.standard_normal((count, m)), dtype=torch.float32, requires_grad=True)
    bias = torch.tensor(0.2 * rng.standard_normal(m), dtype=torch.float32, requires_grad=True)
    _loss(world, weights, bias).backward()
    for parameter in (weights, bias):
        assert parameter.grad is not None
        direction = torch.sign(parameter.grad)
        step = 1e-4
        with torch.no_grad():
            losses = []
            for change in (step * direction, -step * direction):
                parameter += change
                losses.append(_loss(world, weights, bias).item())
                parameter -= change
        expected = (losses[0] - losses[1]) / (2 * step)
        assert float((parameter.grad * direction).sum()) == pytest.approx(expected, rel=0.02, abs=0.01)


WEIGHTS = [np.cos(np.arange(16).reshape(8, 2) + step) for step in range(6)]
NOTHING = np.zeros((8, 0))


def _driven(env: Any, actions: Any) -> tuple[float, MotionTape, dict[str, int]]:
    """A weighted sum of tips, motors, measured tensions and commands after actions (T, B, m), and how pulls ended."""
    _, info = env.reset(seed=5)
    half, phi = info["sampled"]["play_mm"] / 2, info["sampled"]["sheath_friction"]
    motion = MotionTape(Motors(env.config.action_scale_mm, None), env.tangent())
    total, counts = 0.0, dict.fromkeys(("held", "stays", "in_play"), 0)
    for action, weights in zip(actions, WEIGHTS, strict=True):
        env.step(action)
        tangent = env.tangent()
        motion.add(action, tangent)
        for name in counts:
            counts[name] += int(getattr(tangent, name).sum())
        measured = tangent.tensions * np.exp(phi * np.clip((tangent.commands - tangent.motors) / half, -1, 1))
        for value in (tangent.tips, tangent.motors, measured, tangent.commands):
            total += float((value * weights).sum())
    return total, motion, counts


@pytest.mark.slow
def test_gradients_through_pulls_that_limits_cut_are_the_differences() -> None:
    """Of every action, where motors stop with their tendons, in their play and at once."""
    actuation = {"play_mm": (0.5, 1.0), "tension_limit": (3.5, 5.0), "limit_at": "motor"}
    env: Any = gymnasium.make_vec("rj_gym/Instrument-v0", 8, "vector_entry_point", actuation=actuation).unwrapped
    rng, h = np.random.default_rng(2), 1e-4
    actions = rng.uniform(-0.3, 0.8, (6, 8, 2))
    _, motion, counts = _driven(env, actions)
    assert min(counts.values()) > 5, counts
    motion.begin_back()
    gradient = np.stack(
        [motion.back(Readings(weights, weights, weights, NOTHING), weights) for weights in reversed(WEIGHTS)]
    )[::-1]
    wrong = 0
    for place in np.ndindex(*actions.shape):
        change = np.zeros_like(actions)
        change[place] = h
        more, less = (_driven(env, actions + way * change)[0] for way in (1, -1))
        expected = (more - less) / (2 * h)
        wrong += abs(gradient[place] - expected) > 0.01 + 0.01 * abs(expected)
    assert wrong <= 1  # where a pull ends in another way within the difference


class TapedByTorch(RecurrentActor):
    """A RecurrentActor whose derivatives torch takes."""

    def tape(self, steps: int, lanes: int) -> StepTape:
        return StepTape(self)


def _gradients(tape: Tape, x: torch.Tensor, weights: torch.Tensor) -> list[torch.Tensor]:
    """Actions, memories, and gradients by parameters and x of sums with weights over actions and memories."""
    actions = torch.stack([tape.step(row) for row in x])
    tape.begin_back()
    m = actions.shape[-1]
    by_x = [tape.back(by[:, :m], by[:, m:]) for by in reversed(weights)]
    return [actions, tape.memories, *tape.gradients(), torch.stack(by_x)]


def test_gradients_by_hand_through_a_memory_are_those_of_torch() -> None:
    torch.manual_seed(0)
    actor, x, weights = RecurrentActor(5, 2, 16), torch.randn(9, 4, 5), torch.randn(9, 4, 2 + 16)
    by_hand, by_torch = (_gradients(tape, x, weights) for tape in (actor.tape(9, 4), StepTape(actor)))
    for ours, theirs in zip(by_hand, by_torch, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("error", [None, ObservedError((4, 1), 5.0)])
def test_gradients_by_hand_without_memory_are_those_of_torch(error: ObservedError | None) -> None:
    """Of a linear head, and of actions that vanish with the error, here with entries of the error near 0, too."""
    torch.manual_seed(0)
    actor, x, weights = FeedForwardActor(5, 3, (16, 8), error=error), torch.randn(9, 4, 5), torch.randn(9, 4, 3)
    x[2] *= 1e-3
    tapes = actor.tape(9, 4), StepTape(actor)
    assert not isinstance(tapes[0], StepTape)
    for ours, theirs in zip(*(_gradients(tape, x, weights) for tape in tapes), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-5)
    assert isinstance(FeedForwardActor(5, 3, (16, 8), torch.nn.ReLU).tape(9, 4), StepTape)


def test_episodes_by_hand_have_the_gradients_of_torch() -> None:
    """Of errors, actions and memories, with gradients of lanes bounded and pictures that come late."""
    results = []
    for kind in (RecurrentActor, TapedByTorch):
        torch.manual_seed(1)
        env = gymnasium.make_vec(
            "rj_gym/LatePose-v0", LANES, "vector_entry_point", episode_steps=STEPS, observe_history=1,
            autoreset_mode=AutoresetMode.DISABLED,
        )  # fmt: skip
        env.reset(seed=2)
        entries, m = env.single_observation_space.shape[0], env.single_action_space.shape[0]
        actor, scale = kind(entries, m, 16), np.full(entries, 0.5)
        episodes = DifferentiableEpisodes(env.unwrapped, lambda _, scale=scale: (0.0 * scale, scale), 0.3)
        played = episodes.play(actor)
        assert played is not None
        (played.errors[-4:].mean() + played.actions.square().mean() + played.memories.square().mean()).backward()
        results.append([parameter.grad for parameter in actor.parameters()])
        env.close()
    for ours, theirs in zip(*results, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-3, atol=1e-5)
        assert ours is not None and ours.abs().max() > 1e-4
