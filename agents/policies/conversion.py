"""The network of a Stable-Baselines3 model as arrays: the only place that knows how SB3 builds its networks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.network import Network, PolicyError, Vectors

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

ALGORITHMS = ("ppo", "sac", "tqc", "crossq")
UNCLIPPED = float(np.finfo(np.float32).max)
_ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu", "ELU": "elu"}

Array = NDArray[np.float64]


def algorithm_of(model: BaseAlgorithm) -> str:
    """The name of the model's algorithm, one of ALGORITHMS; raises PolicyError for others."""
    name = type(model).__name__.lower()
    if name not in ALGORITHMS:
        raise PolicyError("algorithm", name, f"one of {', '.join(ALGORITHMS)}")
    return name


def network_of(model: BaseAlgorithm, normaliser: Any = None) -> Network:
    """The forward pass of the model's deterministic action.

    Args:
        model: PPO, SAC, TQC or CrossQ with MlpPolicy or MultiInputPolicy.
        normaliser: the VecNormalize that its observations go through, or None.
    Raises:
        PolicyError: another algorithm, or layers that have no form in NumPy.
    """
    algorithm_of(model)
    policy: Any = model.policy
    if hasattr(policy, "actor"):
        extractor, modules = policy.actor.features_extractor, [policy.actor.latent_pi, policy.actor.mu]
    else:
        extractor, modules = policy.pi_features_extractor, [policy.mlp_extractor.policy_net, policy.action_net]
    layers, activation = _layers(modules)
    inputs = _inputs(extractor)
    mean, scale, clip = _normaliser(normaliser, inputs, layers[0][0].shape[1])
    output = "tanh" if policy.squash_output else "clip"
    space: Any = model.action_space
    low, high = (np.asarray(bound, np.float32) for bound in (space.low, space.high))
    return Network(inputs, mean, scale, clip, layers, activation, output, low, high)


def _layers(modules: Iterable[Any]) -> tuple[list[tuple[Vectors, Vectors]], str]:
    """Weights and biases of the linear layers, and the activation between them."""
    layers: list[tuple[Vectors, Vectors]] = []
    between: list[str] = []
    renorm = None
    for module in _flat(modules):
        kind = type(module).__name__
        if kind == "BatchRenorm1d" and renorm is None:
            renorm = module
        elif kind == "Linear" and len(layers) == len(between):
            layers.append(_folded(module, renorm))
            renorm = None
        elif kind in _ACTIVATIONS and len(layers) > len(between) and renorm is None:
            between.append(_ACTIVATIONS[kind])
        else:
            raise PolicyError("layer", kind, f"linear layers with one of {', '.join(_ACTIVATIONS)} between them")
    if len(layers) != len(between) + 1 or len(set(between)) > 1:
        raise PolicyError("layers", between, "linear layers with the same activation between all of them")
    return layers, between[0] if between else "tanh"


def _flat(modules: Iterable[Any]) -> Iterator[Any]:
    """The modules in the order of computation, sequences of modules resolved."""
    for module in modules:
        if type(module).__name__ == "Sequential":
            yield from _flat(module)
        else:
            yield module


def _folded(linear: Any, renorm: Any) -> tuple[Vectors, Vectors]:
    """Weights and biases of a linear layer with the batch renormalisation before it folded in.

    W (s (x - mean) / sqrt(var + eps) + t) + b = (W f) x + b + W (t - f mean), with f = s / sqrt(var + eps).
    """
    weights, biases = _numbers(linear.weight), _numbers(linear.bias)
    if renorm is not None:
        factor = _numbers(renorm.scale) / np.sqrt(_numbers(renorm.ra_var) + renorm.eps)
        biases = biases + weights @ (_numbers(renorm.bias) - factor * _numbers(renorm.ra_mean))
        weights = weights * factor
    return weights.astype(np.float32), biases.astype(np.float32)


def _inputs(extractor: Any) -> dict[str, int]:
    """Entries by key of a dictionary observation, in SB3's order of concatenation; nothing for a vector."""
    kind = type(extractor).__name__
    if kind == "FlattenExtractor":
        return {}
    if kind != "CombinedExtractor":
        raise PolicyError("features extractor", kind, "FlattenExtractor or CombinedExtractor")
    return {key: int(np.prod(extractor._observation_space[key].shape)) for key in extractor.extractors}


def _normaliser(normaliser: Any, inputs: Mapping[str, int], entries: int) -> tuple[Array, Array, Array]:
    """Mean, scale and clip of every entry, (entries,) each: those that change nothing where nothing is normalised."""
    if normaliser is None or not normaliser.norm_obs:
        return np.zeros(entries), np.ones(entries), np.full(entries, UNCLIPPED)
    if not inputs:
        return _statistics(normaliser, normaliser.obs_rms)
    parts = []
    for key, count in inputs.items():
        if key in normaliser.norm_obs_keys:
            parts.append(_statistics(normaliser, normaliser.obs_rms[key]))
        else:
            parts.append((np.zeros(count), np.ones(count), np.full(count, UNCLIPPED)))
    mean, scale, clip = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return mean, scale, clip


def _statistics(normaliser: Any, running: Any) -> tuple[Array, Array, Array]:
    mean = np.array(running.mean, float)
    return mean, np.sqrt(running.var + normaliser.epsilon), np.full(mean.shape, float(normaliser.clip_obs))


def _numbers(tensor: Any) -> Array:
    return tensor.detach().cpu().numpy().astype(float)
