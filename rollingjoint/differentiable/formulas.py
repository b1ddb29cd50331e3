"""Formulas of kernels as functions of tensors: the kernels' own source, with the operations of torch.

A part of a kernel that works number by number serves tensors of shapes that broadcast, gradients included, as it serves
SIMD lanes: `of_tensors` runs its Python code on them. Vectors are tuples of tensors, one per coordinate.
"""

from __future__ import annotations

import types
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from rollingjoint.kernels import joints
from rollingjoint.transmission import kernels as transmission

Vector = tuple[Tensor, ...]


def _root(value: Tensor) -> Tensor:
    """The square root; its gradient at 0 is 0."""
    if not value.requires_grad:
        return value.sqrt()
    positive = value.detach() > 0.0
    return torch.where(positive, torch.where(positive, value, 1.0).sqrt(), 0.0)


def _plus_dot(start: Tensor, a: Vector, b: Vector) -> Tensor:
    for pair in zip(a, b, strict=True):
        start = torch.addcmul(start, *pair)
    return start


_INSTEAD: dict[str, Any] = {
    "dot": lambda a, b: _plus_dot(a[0] * b[0], a[1:], b[1:]),
    "plus_dot": _plus_dot,
    "plus": lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True)),
    "minus": lambda a, b: tuple(x - y for x, y in zip(a, b, strict=True)),
    "times": lambda a, factor: tuple(x * factor for x in a),
    "about": lambda axis, arm: (-arm[1], arm[0]),  # in the plane
    "where": torch.where,
    "min": lambda value, high: value.clamp(max=high),
    "max": lambda value, low: value.clamp(min=low),
    "math": types.SimpleNamespace(sqrt=_root, exp=torch.exp, log=torch.log),
}


def of_tensors(part: Any) -> Callable[..., Any]:
    """A part of a kernel as a function of tensors; the parts that it calls are made so, too."""
    function = part.py_func
    names = dict(function.__globals__)
    for name in function.__code__.co_names:
        if name in _INSTEAD:
            names[name] = _INSTEAD[name]
        elif hasattr(names.get(name), "py_func"):
            names[name] = of_tensors(names[name])
    return types.FunctionType(function.__code__, names, function.__name__)


_OF_MOTORS = (
    transmission.at_limit,
    transmission.elastic_tension,
    transmission.motor_yield,
    transmission.paid_out,
    transmission.play_step,
    transmission.pull_end,
    transmission.pull_limit,
    transmission.sheath_direction,
    transmission.sheath_ratio,
    transmission.unstretched_length,
)
(
    at_limit,
    elastic_tension,
    motor_yield,
    paid_out,
    play_step,
    pull_end,
    pull_limit,
    sheath_direction,
    sheath_ratio,
    unstretched_length,
) = map(of_tensors, _OF_MOTORS)
straight_gap, gap_rates = of_tensors(joints.straight_gap), of_tensors(joints.gap_rates)
