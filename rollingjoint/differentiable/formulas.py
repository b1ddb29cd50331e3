"""Formulas of kernels as functions of tensors: the kernels' own source, with the operations of torch.

A part of a kernel that works number by number serves tensors of shapes that broadcast, gradients included, as it serves
SIMD lanes: `of_tensors` runs its Python code on them. Vectors are tuples of tensors, one per coordinate.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

from rollingjoint.kernels import joints
from rollingjoint.transmission import kernels as transmission

Vector = tuple[Tensor, ...]


def root(value: Tensor) -> Tensor:
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
    "math": types.SimpleNamespace(sqrt=root, exp=torch.exp, log=torch.log),
}


def of_tensors(part: Any, instead: Mapping[str, Any] = _INSTEAD) -> Callable[..., Any]:
    """A part of a kernel as a function of tensors; the parts that it calls are made so, too.

    instead: what stands for names in their source, which numba knows and tensors do not.
    """
    function = part.py_func
    names = dict(function.__globals__)
    for name in function.__code__.co_names:
        if name in instead:
            names[name] = instead[name]
        elif hasattr(names.get(name), "py_func"):
            names[name] = of_tensors(names[name], instead)
    return types.FunctionType(function.__code__, names, function.__name__)


at_limit = of_tensors(transmission.at_limit)
elastic_tension = of_tensors(transmission.elastic_tension)
motor_yield = of_tensors(transmission.motor_yield)
paid_out = of_tensors(transmission.paid_out)
play_step = of_tensors(transmission.play_step)
pull_end = of_tensors(transmission.pull_end)
pull_limit = of_tensors(transmission.pull_limit)
sheath_direction = of_tensors(transmission.sheath_direction)
sheath_ratio = of_tensors(transmission.sheath_ratio)
unstretched_length = of_tensors(transmission.unstretched_length)
straight_gap, gap_rates = of_tensors(joints.straight_gap), of_tensors(joints.gap_rates)
