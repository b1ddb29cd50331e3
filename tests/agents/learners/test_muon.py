"""Muon: orthogonal updates of matrices, Adam's for the rest, and state that is saved."""

from __future__ import annotations

import pytest
import torch

from agents.learners.muon import ADAMS, Muon, orthogonal


@pytest.mark.parametrize("shape", [(1, 40, 24), (3, 24, 24), (2, 12, 60)])
def test_matrices_become_orthogonal(shape: tuple[int, ...]) -> None:
    torch.manual_seed(0)
    matrices = torch.randn(shape) * torch.logspace(0, 3, shape[2])  # singular values far apart
    u, _, vh = torch.linalg.svd(matrices, full_matrices=False)
    found = orthogonal(matrices)
    values = torch.linalg.svdvals(found)
    assert values.max() < 1.3 and values[:, : shape[1] // 2].min() > 0.6
    assert torch.linalg.matrix_norm(found - u @ vh).max() < 0.5 * torch.linalg.matrix_norm(u @ vh).max()
    assert torch.equal(orthogonal(torch.zeros(shape)), torch.zeros(shape))


def test_an_update_is_as_long_as_one_of_adam() -> None:
    torch.manual_seed(0)
    weight = torch.nn.Parameter(torch.randn(48, 16))
    optimizer = Muon([{"params": [weight], "blocks": 3}], lr=0.01)
    weight.grad, before = torch.randn(48, 16), weight.detach().clone()
    optimizer.step()
    change = (weight.detach() - before) / 0.01
    assert change.square().mean().sqrt().item() == pytest.approx(ADAMS, rel=0.2)
    for block in change.split(16):  # every one of the three on its own
        assert torch.linalg.svdvals(block).max() < 1.3 * ADAMS * 4


def test_biases_and_narrow_matrices_are_changed_as_by_adam() -> None:
    torch.manual_seed(0)
    start = [torch.randn(20), torch.randn(2, 20)]
    found = []
    for kind in (Muon, torch.optim.Adam):
        parameters = [torch.nn.Parameter(each.clone()) for each in start]
        optimizer = kind(parameters, lr=0.01)
        generator = torch.Generator().manual_seed(1)
        for _ in range(5):
            for each in parameters:
                each.grad = torch.randn(each.shape, generator=generator)
            optimizer.step()
        found.append(parameters)
    for ours, theirs in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-7)


def test_a_closure_takes_the_gradients_anew() -> None:
    weight = torch.nn.Parameter(torch.ones(2))
    optimizer = Muon([weight], lr=0.1)

    def closure() -> torch.Tensor:
        optimizer.zero_grad()
        loss = weight.square().sum()
        loss.backward()
        return loss

    assert optimizer.step(closure).item() == 2.0
    assert weight.max() < 1.0
