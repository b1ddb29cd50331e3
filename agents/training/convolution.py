"""A temporal convolution over past readings, before the hidden layers of a policy or a value function.

Every layer joins three neighbouring steps into one, with the same weights wherever they are, until a single one is
left: the last output of a causal convolutional network with kernels of 3 and dilations 1, 3, 9, ..., without
the values on which that output does not depend. Every kernel of the first layer also sees the present readings and the
target. Source: Bai, Kolter, Koltun, An Empirical Evaluation of Generic Convolutional and Recurrent Networks for
Sequence Modeling, 2018.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from agents.training.asymmetric import ACTOR
from rj_gym.core.task import Entry

KERNEL = 3


class SharedLinear(nn.Module):
    """One linear layer applied to several groups of its inputs, with outputs side by side.

    Args:
        groups: places of every group's inputs among all inputs, lists of one length; -1 stands for a zero.
        inputs: number of inputs. width: of the output of a group.
    """

    places: torch.Tensor

    def __init__(self, groups: Sequence[Sequence[int]], inputs: int, width: int) -> None:
        super().__init__()
        self.inputs = inputs
        self.linear = nn.Linear(len(groups[0]), width)
        places = torch.tensor(groups)
        self.register_buffer("places", places.where(places >= 0, inputs), persistent=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Outputs (B, groups x width) of x (B, inputs)."""
        padded = nn.functional.pad(x, (0, 1))
        outputs: torch.Tensor = self.linear(padded[:, self.places])
        return outputs.flatten(1)

    def dense(self) -> nn.Linear:
        """The same as a linear layer of all inputs with most weights zero."""
        groups, width = len(self.places), self.linear.out_features
        weights = torch.zeros(groups, width, self.inputs + 1)
        spread = self.places[:, None].expand(groups, width, -1)
        weights.scatter_(2, spread, self.linear.weight.detach().expand(groups, -1, -1))
        layer = nn.Linear(self.inputs, groups * width)
        with torch.no_grad():
            layer.weight.copy_(weights[..., :-1].flatten(0, 1))
            layer.bias.copy_(self.linear.bias.repeat(groups))
        return layer


class PastConvolution(BaseFeaturesExtractor):
    """Features of an observation, with a convolution of its past readings.

    Args:
        space: of observations: a vector, or a dictionary with the policy's vector under "observation".
        past: places of the readings of every past step in that vector, the oldest step first.
        width: of every layer. activation: class of the module after every layer.
    """

    def __init__(self, space: spaces.Space[Any], past: Sequence[Sequence[int]], width: int, activation: Any) -> None:
        super().__init__(space, width)
        self.entries = spaces.flatdim(space[ACTOR] if isinstance(space, spaces.Dict) else space)
        past_entries = {place for step in past for place in step}
        present = [place for place in range(self.entries) if place not in past_entries]
        layers: list[nn.Module] = []
        steps, inputs, seen_by_all = [list(step) for step in past], self.entries, present
        while not layers or len(steps) > 1:
            groups = [group + seen_by_all for group in _joined(steps)]
            layers += [SharedLinear(groups, inputs, width), activation()]
            steps = [list(range(first, first + width)) for first in range(0, len(groups) * width, width)]
            inputs, seen_by_all = len(groups) * width, []
        self.layers = nn.Sequential(*layers)

    def forward(self, observation: Any) -> torch.Tensor:
        """The features (B, width)."""
        features: torch.Tensor = self.layers(observation[ACTOR] if isinstance(observation, dict) else observation)
        return features


def past_places(entries: Sequence[Entry]) -> list[list[int]]:
    """The places of the readings of every past step among the entries of an observation, the oldest step first."""
    steps: dict[int, list[int]] = {}
    for place, entry in enumerate(entries):
        if lag := re.search(r", lag (\d+)$", entry.name):
            steps.setdefault(int(lag[1]), []).append(place)
    return [steps[lag] for lag in sorted(steps, reverse=True)]


def _joined(steps: list[list[int]]) -> list[list[int]]:
    """KERNEL neighbouring steps each as one, the newest ones whole; before the oldest step there are zeros."""
    missing = -len(steps) % KERNEL
    padded = [[-1] * len(steps[0])] * missing + steps
    return [list(chain.from_iterable(padded[first : first + KERNEL])) for first in range(0, len(padded), KERNEL)]
