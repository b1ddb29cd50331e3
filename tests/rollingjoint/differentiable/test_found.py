"""Equilibria that compiled batches have found, as functions of the design and of the commands."""

import numpy as np
import pytest
import torch

from rj_gym.surroundings.config import LumenConfig
from rj_gym.surroundings.task import LumenTask
from rollingjoint import HalfPlane, Sleeve, Surroundings, WorldForce, five_link, solve_lengths_batch
from rollingjoint.design import DesignSpace
from rollingjoint.differentiable import (
    DifferentiableChain,
    DifferentiableFriction,
    DifferentiableSurroundings,
    of_solutions,
    solve_lengths,
)
from rollingjoint.errors import InvalidInput

LIMITS = (0.5, 15.0)
LANES, FEEDS = 3, (16.0, 20.0, 24.0, 28.0, 32.0)


def pushed(mu, mechanism=None):
    """The steps of lumens that a resting instrument is fed into, and their commands."""
    config = {"families": ["hard"], "mu": mu}
    nominal = LumenTask(LumenConfig(**config))
    scenes, _ = nominal.sample([np.random.default_rng(seed) for seed in range(LANES)])
    task = nominal if mechanism is None else LumenTask(LumenConfig(mechanism=mechanism, **config))
    commands = np.repeat(nominal.rest[None], LANES, axis=0) + np.array([-0.8, 0.8, -0.4, 0.4])  # bent: none buckles
    steps = [task.at_rest(scenes.walls, commands)]
    for feed in FEEDS:
        steps.append(task.solve(scenes.walls, commands, np.full(LANES, feed), steps[-1]))
    return nominal, steps, commands


def outputs(found):
    return torch.cat([found.joint_angles, found.tensions, found.wall_forces[..., :2].flatten(-2)], -1)


def numbers(steps):
    return np.concatenate(
        [np.concatenate([s.joint_angles, s.tensions, s.walls.forces[..., :2].reshape(LANES, -1)], -1) for s in steps]
    )


def weighted(steps, commands, chain):
    """A sum of all outputs with fixed weights, and what it is in numbers."""
    found = of_solutions(chain, steps, torch.as_tensor(np.tile(commands, (len(steps), 1))), LIMITS)
    flat = outputs(found)
    weights = torch.as_tensor(np.random.default_rng(5).normal(size=flat.shape))
    return (flat * weights).sum(), lambda other: float((numbers(other) * weights.numpy()).sum())


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_gradient_by_the_design_is_that_of_differences_of_whole_rollouts(mu):
    task, steps, commands = pushed(mu)
    space = DesignSpace.of(task.mechanism, hole_radius=(-0.5, 0.5), symmetric=True)
    x = torch.tensor(space.reference(), requires_grad=True)
    total, in_numbers = weighted(steps, commands, space.chain(x))
    assert float(total.detach()) == pytest.approx(in_numbers(steps), rel=1e-9)
    assert numbers(steps)[:, -18:].any(), "the walls press"
    total.backward()
    way = np.random.default_rng(0).normal(size=space.dimensions)
    ends = [pushed(mu, space.mechanism(space.reference() + h * way))[1] for h in (1e-5, -1e-5)]
    difference = (in_numbers(ends[0]) - in_numbers(ends[1])) / 2e-5
    exact = 1e-6 if mu == 0.0 else 2e-2  # with friction, contacts that stick are pinned
    assert float(x.grad @ torch.as_tensor(way)) == pytest.approx(difference, rel=exact)


def test_gradient_by_commands_is_that_of_the_solver_in_tensors():
    wall = Surroundings([HalfPlane((1.0, 0.0), -40.0, stiffness=2.0)], Sleeve(6.0))
    mechanism = five_link()
    lengths = mechanism.neutral_lengths + np.array([[-9.0, 3.0], [-10.0, 3.0]])
    loads = [WorldForce(-1, (0.1, -0.2))]
    solution = solve_lengths_batch(mechanism, lengths, loads, surroundings=wall)
    assert solution.ok.all() and (solution.walls.normals.max(axis=1) > 0.1).all()
    chain, gradients = DifferentiableChain.from_mechanism(mechanism), []
    around = DifferentiableSurroundings.of(wall, mechanism)
    for way in ("found", "solved"):
        command = torch.tensor(lengths, requires_grad=True)
        if way == "found":
            found = of_solutions(chain, [solution], command)
        else:
            begin = torch.tensor(np.array(solution.joint_angles))
            found = solve_lengths(chain, command, loads, begin, surroundings=around)
        torch.testing.assert_close(found.tip.detach(), torch.tensor(solution.tip), rtol=0.0, atol=1e-8)
        (found.tip.sum() + found.wall_forces[..., :2].square().sum() + found.tensions.sum()).backward()
        gradients.append(command.grad)
    torch.testing.assert_close(*gradients, rtol=1e-7, atol=1e-9)


def test_what_does_not_fit_is_refused():
    mechanism = five_link()
    chain = DifferentiableChain.from_mechanism(mechanism)
    lengths = np.repeat(mechanism.neutral_lengths[None], 2, axis=0) - 1.0
    solution = solve_lengths_batch(mechanism, lengths)
    with pytest.raises(InvalidInput, match=r"expected \(2, 2\), as in the solutions"):
        of_solutions(chain, [solution], torch.as_tensor(lengths[:1]))
    rubbing = chain.replace(friction=DifferentiableFriction(0.1))
    with pytest.raises(InvalidInput, match="friction in holes"):
        of_solutions(rubbing, [solution], torch.as_tensor(lengths))
    rigid = Surroundings([HalfPlane((1.0, 0.0), -40.0)], Sleeve(6.0), rigid=True)
    pressed = solve_lengths_batch(mechanism, lengths, surroundings=rigid)
    with pytest.raises(InvalidInput, match="rigid"):
        of_solutions(chain, [pressed], torch.as_tensor(lengths))
