"""Gradients among walls: values are those of the compiled solver, gradients those of differences of it."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import Bare, Capsule, Disc, HalfPlane, InvalidInput, Lumen, Polygon, Sleeve, Surroundings, WallFriction
from rollingjoint.load import load_table

torch = pytest.importorskip("torch")

from rollingjoint.differentiable import (  # noqa: E402 - needs torch
    DifferentiableChain,
    DifferentiableFriction,
    DifferentiableSpatialChain,
    DifferentiableSurroundings,
    solve_lengths,
    solve_tensions,
)
from rollingjoint.differentiable.surroundings import PARAMETERS, numeric  # noqa: E402

torch.set_num_threads(1)

CHAIN = rj.two_segment(4, 4, height=10, radius=7, half_width=5)
LENGTHS = CHAIN.neutral_lengths - 2.0 / CHAIN.stiffnesses + [0.4, -0.3, 0.2, 0.1]
LIMITS = (0.5, 15.0)
LUMEN = Lumen([30, 40, 40, 30], [0, 0.02, -0.02, 0], [8, 8, 7.5, 7, 7], stiffness=2, toe=0.3)
SCENES = {
    "a lumen that tapers, a disc in it, a plane": (
        Surroundings([LUMEN, Disc((-9, 66), 4.0), HalfPlane((1, 0.1), -33, stiffness=3)], Sleeve(5.0)),
        (0.1, 30.0, 0.05),
    ),
    "naked links at a capsule, a polygon and two planes": (
        Surroundings(
            [
                Capsule((-9, 45), (-9, 66), 2.0, stiffness=3),
                Polygon([(9, 40), (16, 40), (9, 60)], stiffness=4, toe=0.2),
                HalfPlane((-1, 0.1), -3.4, stiffness_per_length=0.3),
                HalfPlane((0, -1), -79, stiffness=0.5),
            ],
            Bare(1.0),
        ),
        (0.3, 1.0, -0.02),
    ),
    "a lumen by length of outline": (
        Surroundings([Lumen.through([(0, 0), (0, 55), (-30, 90), (-30, 150)], 8.0, 35.0, stiffness_per_length=0.2)],
            Sleeve(5.0, points=6)),
        (0.0, 25.0, 0.0),
    ),
    "rigid walls": (
        Surroundings([Lumen([40, 50, 60], [0, 0.012, 0], 7.0), Disc((8, 55), 4.0)], Sleeve(5.0), rigid=True),
        (0.0, 25.0, 0.0),
    ),
}  # fmt: skip
FIELDS = ("tip", "poses", "tensions", "wall_forces", "insertion_force", "contact_forces", "lengths")


def fields_of(equilibrium):
    return [getattr(equilibrium, name) for name in FIELDS]


def weights(equilibrium, seed):
    """Weights of the sum of all fields, each of about the same size."""
    rng = np.random.default_rng(seed)
    return [
        rng.normal(size=np.shape(values)) / max(1.0, np.abs(np.asarray(values)).max()) for values in fields_of(equilibrium)
    ]


def differentiable(scene, requires_grad=PARAMETERS):
    around, base = SCENES[scene]
    walls = DifferentiableSurroundings.of(around, CHAIN, requires_grad)
    leaves = {name: getattr(walls, name) for name in requires_grad if getattr(walls, name).numel()}
    leaves["base"] = torch.tensor(base, requires_grad=True, dtype=torch.float64)
    leaves["commands"] = torch.tensor(LENGTHS, requires_grad=True)
    leaves["loads"] = torch.tensor(load_table([rj.WorldForce(-1, (0.1, -0.05))], CHAIN.n_links), requires_grad=True)
    return walls, leaves


def solved(walls, leaves, start=None):
    """The equilibrium of the compiled solver at the values of tensors."""
    arrays = numeric(walls.tables(), walls.rigid)
    numbers = {name: leaves[name].detach().numpy() for name in ("base", "commands", "loads")}
    force = [rj.WorldForce(-1, tuple(numbers["loads"][0, 3:5]))]
    return rj.solve_lengths(
        CHAIN, numbers["commands"], force, start, tension_limits=LIMITS, surroundings=arrays, base=numbers["base"]
    )


def changed(leaves, walls, name, at, by):
    """The walls and leaves after a change of one number."""
    tensor = leaves[name].detach().clone()
    tensor[at] += by
    if name in PARAMETERS:
        return walls.replace(**{name: tensor}), leaves
    return walls, leaves | {name: tensor}


def numbers_of(leaves):
    """Names and places of all numbers that solves depend on smoothly."""
    for name, tensor in leaves.items():
        for at in np.ndindex(*tensor.shape):
            outline = name in ("points", "bars") and at[1] == 0  # the link
            length = name == "points" and at[1] == 4
            begins = name == "toes" and tensor[at] == 0.0  # to one side only
            if not (outline or length or begins) and (name != "loads" or at == (0, 3)):
                yield name, at


@pytest.mark.parametrize("scene", SCENES)
def test_values_are_those_of_the_compiled_solver(scene):
    walls, leaves = differentiable(scene, ())
    expected = solved(walls, leaves)
    assert len(expected.wall_contacts) >= 2 and expected.ok
    found = solve_lengths(
        DifferentiableChain.from_mechanism(CHAIN), leaves["commands"], leaves["loads"], surroundings=walls,
        base=leaves["base"], tension_limits=LIMITS,
    )  # fmt: skip
    rigid = SCENES[scene][0].rigid
    for name, values in zip(FIELDS, fields_of(expected), strict=True):
        np.testing.assert_allclose(getattr(found, name).detach(), values, atol=1e-6 if rigid else 1e-9, err_msg=name)
    H = expected.stiffness
    np.testing.assert_allclose(found.stiffness.detach(), H, atol=1e-9 * np.abs(H).max())
    pressing = found.wall_normals.detach().numpy() > 0.0
    np.testing.assert_array_equal(pressing, expected.walls.normals > 0.0)
    np.testing.assert_allclose(found.wall_gaps.detach().numpy()[pressing], expected.walls.gaps[pressing], atol=1e-9)


@pytest.mark.parametrize("scene", SCENES)
def test_gradients_are_those_of_differences(scene):
    """By every number of walls and outline, by the base, the commands and a load: central differences of four solves."""
    walls, leaves = differentiable(scene)
    found = solve_lengths(
        DifferentiableChain.from_mechanism(CHAIN), leaves["commands"], leaves["loads"], surroundings=walls,
        base=leaves["base"], tension_limits=LIMITS,
    )  # fmt: skip
    at = solved(walls, leaves)
    every = weights(at, 0)
    total = sum((values * torch.as_tensor(w)).sum() for values, w in zip(fields_of(found), every, strict=True))
    gradients = dict(zip(leaves, torch.autograd.grad(total, list(leaves.values()), materialize_grads=True), strict=True))

    def value(name, place, by):
        moved = solved(*changed(leaves, walls, name, place, by), start=at)
        return sum(float((np.asarray(v) * w).sum()) for v, w in zip(fields_of(moved), every, strict=True))

    for name, size in ((name, float(gradients[name].abs().max())) for name in leaves):
        for leaf, place in numbers_of({name: leaves[name]}):
            h = (2e-3 if walls.rigid else 2e-4) * min(1.0, max(1e-2, abs(float(leaves[leaf].detach()[place]))))
            wide, narrow = ((value(leaf, place, k) - value(leaf, place, -k)) / (2.0 * k) for k in (h, 0.5 * h))
            difference = (4.0 * narrow - wide) / 3.0
            error = abs(float(gradients[leaf][place]) - difference)
            assert error < 1e-6 * size + 1e-7, (leaf, place, float(gradients[leaf][place]), difference)
