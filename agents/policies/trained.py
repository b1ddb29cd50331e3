"""The policy of a run as a controller, read from its run folder without unpickling anything."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from agents.controllers.controller import Controller, Mask, plain
from agents.controllers.policy import Policy
from agents.controllers.residual import controller_of
from agents.policies.base import PolicyNetwork, memory_after_reset
from agents.policies.content import located, network_in
from agents.policies.conversion import algorithm_of, network_of, observations_behind
from agents.policies.errors import PolicyError
from agents.policies.file import pack, read_bytes, unpack
from agents.policies.layers import Vectors
from agents.policies.parameters import load_parameters
from agents.policies.pickled import load_pickled
from agents.runs.checks import integer, number
from agents.runs.config import TrainConfig
from agents.runs.files import RunFolderError
from agents.runs.folder import PolicyFiles, RunFolder
from rollingjoint.checked_yaml import mapping, text

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

KEYS = ("algorithm", "network", "steps", "observations")
LARGEST_FILE = 2**30


@dataclass(eq=False)
class TrainedPolicy(Controller):
    """A policy as it acts, a controller that runs with NumPy alone. Its environment is its run's.

    Args:
        network: its forward pass, with the normaliser.
        algorithm: of its training, "ppo" for example.
        steps: of training.
        observations: behind the statistics of the normaliser; 0 where observations are not normalised.
    """

    one_mechanism = False

    network: PolicyNetwork
    algorithm: str
    steps: int
    observations: float = 0.0
    _memory: Vectors | None = field(default=None, init=False, repr=False)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,)."""
        self._memory = memory_after_reset(self.network, self._memory, mask)

    def act(self, observations: Any) -> Vectors:
        """The actions, (B, m); of an observation in parts a policy that saw a vector sees "observation"."""
        observation = plain(observations)
        if isinstance(observation, Mapping) and not self.network.inputs:
            observation = observation["observation"]
        actions, self._memory = self.network.advance(observation, self._memory)
        return actions

    def to_bytes(self) -> bytes:
        """The file policy.safetensors of a run folder."""
        values = (self.algorithm, self.network.description(), self.steps, self.observations)
        return pack(dict(zip(KEYS, values, strict=True)), self.network.tensors())

    @classmethod
    def from_bytes(cls, data: bytes, source: str = "policy file") -> TrainedPolicy:
        """The policy in such a file, named `source` in messages; raises PolicyError for a damaged or another one."""
        values, tensors = unpack(data, source)
        with located(source):
            content = mapping("top level", values, KEYS, KEYS)
            return cls(
                network_in(content["network"], tensors),
                text("algorithm", content["algorithm"]),
                integer(0)("steps", content["steps"]),
                number(0.0)("observations", content["observations"]),
            )


def policy_of(model: BaseAlgorithm, normaliser: Any = None) -> TrainedPolicy | Policy:
    """The policy of a model as it is now; where that has no form in NumPy, the model itself as a controller.

    Args:
        normaliser: the VecNormalize that its observations go through, or None.
    """
    try:
        network = network_of(model, normaliser)
    except PolicyError:
        return Policy(model, normaliser)
    return TrainedPolicy(network, algorithm_of(model), model.num_timesteps, observations_behind(normaliser))


def load_trained(run: RunFolder, which: str = "best") -> TrainedPolicy | Policy:
    """The policy "best", "last" or of a checkpoint.

    Raises:
        RunFolderError: no such policy, one that cannot be read, or one in pickles alone, which are not allowed.
        PolicyError: a policy.safetensors that cannot be read.
    """
    files = run.saved_policy(which)
    if files.network.is_file():
        return read_trained(files)
    if files.parameters.is_file():
        return load_parameters(run.config(), files.parameters)
    old = load_pickled(run.config(), files)
    return policy_of(old.model, old.normaliser)


def read_trained(files: PolicyFiles) -> TrainedPolicy:
    """The policy in policy.safetensors; raises PolicyError if it cannot be read."""
    return TrainedPolicy.from_bytes(read_bytes(files.network, LARGEST_FILE), str(files.network))


def load_driving(run: RunFolder, which: str = "best", in_wrappers: bool = False) -> Controller:
    """The policy of a run folder as a controller, alone or added to its guide; raises as load_trained.

    Args:
        in_wrappers: whether the caller makes its environment by `envs_for`, in the wrappers of its training; else a
            policy that needs them is refused.
    """
    if not in_wrappers:
        check_unwrapped(run.config())
    return controller_of(run.config(), load_trained(run, which))


def check_unwrapped(config: TrainConfig) -> None:
    """Raise RunFolderError for a policy that acts through wrappers."""
    names = [name for each in config.policy_wrappers for name in each]
    if names:
        raise RunFolderError("wrappers", names, "[], or wrappers of rewards alone", "rj evaluate makes them again.")
