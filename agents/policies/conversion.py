"""Trained networks as arrays: the only place that knows how Stable-Baselines3, and RecurrentActor, build theirs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.base import PolicyNetwork
from agents.policies.cells import NAMES, Gru, Lstm
from agents.policies.errors import PolicyError
from agents.policies.gain import GainForm, GainNetwork
from agents.policies.layers import Vectors
from agents.policies.network import CLIP, Network
from agents.policies.recurrent import RecurrentNetwork
from agents.policies.stacked import StackedNetwork
from agents.runs.algorithms import OWN

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

ALGORITHMS = {
    "PPO": "ppo",
    "SAC": "sac",
    "TQC": "tqc",
    "CrossQ": "crossq",
    "RecurrentPPO": "recurrent_ppo",
    "APG": "apg",
    "Distill": "distill",
}
UNCLIPPED = float(np.finfo(np.float32).max)
_LINEAR = ("weight", "bias")
_RECURRENT = ("weight_ih_l0", "weight_hh_l0", "bias_ih_l0", "bias_hh_l0")  # in the order of a Cell
_ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu", "ELU": "elu"}

Array = NDArray[np.float64]


def algorithm_of(model: BaseAlgorithm) -> str:
    """The name of the model's algorithm, one of ALGORITHMS; raises PolicyError for others."""
    name = type(model).__name__
    if name not in ALGORITHMS:
        raise PolicyError("algorithm", name.lower(), f"one of {', '.join(ALGORITHMS.values())}")
    return ALGORITHMS[name]


def network_of(model: BaseAlgorithm, normaliser: Any = None) -> PolicyNetwork:
    """The forward pass of the model's deterministic action.

    Args:
        model: of one of ALGORITHMS; its policy sees a vector or, but for an asymmetric one, goals.
        normaliser: the VecNormalize that its observations go through, or None.
    Raises:
        PolicyError: another algorithm, or layers that have no form in NumPy.
    """
    policy: Any = model.policy
    _check_spaces(model)
    if algorithm_of(model) in OWN:
        is_recurrent = type(policy.actor).__name__ == "RecurrentActor"
        return (recurrent_network if is_recurrent else feed_forward_network)(policy.actor, normaliser)
    if hasattr(policy, "actor"):
        extractor, hidden, head = policy.actor.features_extractor, policy.actor.latent_pi, policy.actor.mu
    else:
        extractor, hidden, head = policy.pi_features_extractor, policy.mlp_extractor.policy_net, policy.action_net
    modules: list[Any] = [hidden, head]
    modules, output = _without_clip(modules, "tanh" if policy.squash_output else "clip")
    convolves = type(extractor).__name__ == "PastConvolution"
    layers, activation = _layers([extractor.layers, *modules] if convolves else modules)
    inputs = _inputs(extractor)
    normalised = _normaliser(normaliser, inputs, extractor.entries if convolves else extractor.features_dim)
    space: Any = model.action_space
    low, high = (np.asarray(bound, np.float32) for bound in (space.low, space.high))
    if hasattr(policy, "lstm_actor"):
        cell = Lstm(*_cell_arrays(policy.lstm_actor))
        return RecurrentNetwork(inputs, *normalised, [], cell, layers, activation, False, low, high)
    values = _values(inputs, normalised, layers, activation, output, low, high)
    frames = _frames(model.get_env())
    return StackedNetwork(**values, frames=frames) if frames > 1 else _without_memory(head, values)


def recurrent_network(actor: Any, normaliser: Any = None) -> RecurrentNetwork:
    """The forward pass of a RecurrentActor, with actions in [-1, 1].

    Args:
        actor: an agents.learners.recurrent.RecurrentActor.
        normaliser: the VecNormalize that its observations go through, or None.
    """
    (encoder, *head), activation = _layers([actor.encoder, actor.head])
    mean, scale, clip = _normaliser(normaliser, {}, encoder[0].shape[1])
    cell = Gru(*_cell_arrays(actor.cell))
    bound = np.ones(head[-1][1].shape, np.float32)
    return RecurrentNetwork({}, mean, scale, clip, [encoder], cell, head, activation, True, -bound, bound)


def feed_forward_network(actor: Any, normaliser: Any = None) -> Network:
    """The forward pass of an agents.learners.feed_forward.FeedForwardActor; otherwise as recurrent_network."""
    layers, activation = _layers([actor.hidden, actor.head])
    normalised = _normaliser(normaliser, {}, layers[0][0].shape[1])
    form = _gain_form(actor.head)
    width = layers[-1][1].size
    bound = np.ones(width if form is None else width // (len(form.places) + 1), np.float32)
    return _without_memory(actor.head, _values({}, normalised, layers, activation, "clip", -bound, bound))


def _values(inputs: Any, normalised: tuple[Array, Array, Array], *others: Any) -> dict[str, Any]:
    """The fields of a Network by name."""
    names = [field.name for field in fields(Network)]
    return dict(zip(names, (inputs, *normalised, *others), strict=True))


def _without_memory(head: Any, values: Mapping[str, Any]) -> Network:
    """The network of these fields, of the kind that ends in this layer."""
    form = _gain_form(head)
    return Network(**values) if form is None else GainNetwork(**values, error=form)


def _gain_form(head: Any) -> GainForm | None:
    """The form of a GainHead; None of another layer."""
    if type(head).__name__ != "GainHead":
        return None
    return GainForm(tuple(head.error.places), head.error.unit_mm, head.gain_mm, head.scale_mm)


def _frames(env: Any) -> int:
    """How many observations the policy sees at once, by a VecFrameStack around its lanes."""
    while env is not None:
        if type(env).__name__ == "VecFrameStack":
            return int(env.stacked_obs.n_stack)
        env = getattr(env, "venv", None)
    return 1


def actor_arrays(network: PolicyNetwork) -> dict[str, Vectors]:
    """The parameters of the RecurrentActor, or FeedForwardActor, with this forward pass by name, for load_state_dict.

    Raises:
        PolicyError: a network that neither computes.
    """
    if type(network) in (Network, GainNetwork):
        head = "head.layer" if isinstance(network, GainNetwork) else "head"
        names = [*(f"hidden.{2 * i}" for i in range(len(network.layers) - 1)), head]
        return _named(dict(zip(names, network.layers, strict=True)))
    if (
        not isinstance(network, RecurrentNetwork)
        or not isinstance(network.cell, Gru)
        or not network.shortcut
        or (len(network.encoder), len(network.layers)) != (1, 2)
    ):
        allowed = "what agents.learners trains: layers alone, or one layer, a GRU, two layers, a shortcut"
        raise PolicyError("network", network.description(), allowed)
    layers = {"encoder.0": network.encoder[0], "head.0": network.layers[0], "head.2": network.layers[1]}
    cell = (getattr(network.cell, name) for name in NAMES)
    return _named(layers) | {f"cell.{name}": array for name, array in zip(_RECURRENT, cell, strict=True)}


def _named(layers: Mapping[str, tuple[Vectors, Vectors]]) -> dict[str, Vectors]:
    """Weights and biases of linear layers by the names of their parameters."""
    return {f"{name}.{kind}": a for name, pair in layers.items() for kind, a in zip(_LINEAR, pair, strict=True)}


def observations_behind(normaliser: Any) -> float:
    """Number of observations behind the statistics of a VecNormalize, or None; 0 without normalisation."""
    if normaliser is None or not normaliser.norm_obs:
        return 0.0
    running = normaliser.obs_rms
    return float(min(average.count for average in running.values()) if isinstance(running, Mapping) else running.count)


def _check_spaces(model: BaseAlgorithm) -> None:
    """Raise PolicyError unless observations are vectors, or dictionaries of vectors, and actions are vectors."""
    observations: Any = model.observation_space
    for space in (*getattr(observations, "spaces", {"": observations}).values(), model.action_space):
        if type(space).__name__ != "Box" or len(space.shape or ()) != 1:
            raise PolicyError("space", str(space), "a Box of one dimension, or a dictionary of such")


def _without_clip(modules: Iterable[Any], output: str) -> tuple[list[Any], str]:
    """The modules without the clip of state-dependent exploration (Hardtanh) at their end, and the kind of output."""
    *before, last = flat = list(_flat(modules))
    if output == "tanh" and type(last).__name__ == "Hardtanh" and (last.min_val, last.max_val) == (-CLIP, CLIP):
        return before, "clipped tanh"
    return flat, output


def actor_of(network: RecurrentNetwork) -> Any:
    """The RecurrentActor with this forward pass, for further training; it sees normalised observations."""
    import torch

    from agents.learners.recurrent import RecurrentActor

    actor = RecurrentActor(network.entries, len(network.low), network.cell.width)
    actor.load_state_dict({name: torch.as_tensor(array) for name, array in actor_arrays(network).items()})
    return actor


def with_actor(network: RecurrentNetwork, actor: Any) -> RecurrentNetwork:
    """The network with the layers of a RecurrentActor of its size, and its own normaliser."""
    trained = recurrent_network(actor)
    return replace(network, encoder=trained.encoder, cell=trained.cell, layers=trained.layers)


def _cell_arrays(module: Any) -> list[Vectors]:
    """The arrays of a Cell, of a torch module with one layer."""
    if module.num_layers != 1 or module.bidirectional:
        raise PolicyError("recurrent layers", module.num_layers, "1, in one direction")
    return [_numbers(getattr(module, name)).astype(np.float32) for name in _RECURRENT]


def _layers(modules: Iterable[Any]) -> tuple[list[tuple[Vectors, Vectors]], str]:
    """Weights and biases of the linear layers, and the activation between them."""
    layers: list[tuple[Vectors, Vectors]] = []
    between: list[str] = []
    renorm = None
    for module in _flat(modules):
        kind = type(module).__name__
        if kind == "BatchRenorm1d" and renorm is None:
            renorm = module
        elif kind in ("Linear", "SharedLinear") and len(layers) == len(between):
            layers.append(_folded(module if kind == "Linear" else module.dense(), renorm))
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
        elif type(module).__name__ == "GainHead":
            yield module.layer
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
    """Entries by key of a dictionary observation, in SB3's order of concatenation; empty for a vector.

    ActorsPart, of a policy with a privileged critic, sees the vector alone, and so does PastConvolution.
    """
    kind = type(extractor).__name__
    if kind in ("FlattenExtractor", "ActorsPart", "PastConvolution"):
        return {}
    if kind != "CombinedExtractor":
        raise PolicyError("features extractor", kind, "FlattenExtractor, CombinedExtractor or PastConvolution")
    return {key: int(np.prod(extractor._observation_space[key].shape)) for key in extractor.extractors}


def _normaliser(normaliser: Any, inputs: Mapping[str, int], entries: int) -> tuple[Array, Array, Array]:
    """Mean, scale and clip of every entry, (entries,) each; without normalisation the identity."""
    if normaliser is None or not normaliser.norm_obs:
        return np.zeros(entries), np.ones(entries), np.full(entries, UNCLIPPED)
    if not inputs:
        running = normaliser.obs_rms
        return _statistics(normaliser, running["observation"] if isinstance(running, Mapping) else running)
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
