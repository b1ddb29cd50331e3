"""Networks whose actions vanish with the tip error, in plain NumPy.

Feedback ends at the smallest error that can be reached because it does nothing at the target. A plain network has to
represent "nothing at the target" everywhere, by chance; this form has it built in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Self

import numpy as np

from agents.policies.errors import PolicyError
from agents.policies.layers import ACTIVATIONS, Vectors, through
from agents.policies.network import Network
from agents.runs.checks import integer, number
from rollingjoint.checked_yaml import mapping


@dataclass(frozen=True)
class GainForm:
    """The tip error in an observation, and how outputs y of the last layer become m actions before their bounds.

    With the error e of d coordinates, actions are M e / gain_mm + b |e| / (|e| + scale_mm): the first m d outputs are
    the rows of M, the last m are b.

    Args:
        places: of the coordinates of the error in the observation. unit_mm: of these entries [mm].
        gain_mm: error at which an entry of M is an action [mm]. scale_mm: error at which half of b is left [mm].
    """

    places: tuple[int, ...]
    unit_mm: float
    gain_mm: float
    scale_mm: float

    @classmethod
    def from_dict(cls, values: Any) -> Self:
        """The form in plain values; raises PolicyError or ConfigError for values that cannot be one."""
        keys = ("places", "unit_mm", "gain_mm", "scale_mm")
        values = dict(mapping("error", values, keys, keys))
        if not isinstance(values["places"], list) or not values["places"]:
            raise PolicyError("error.places", values["places"], "a list of places in the observation")
        places = tuple(integer(0)("error.places", place) for place in values.pop("places"))
        return cls(places, **{name: number(1e-6)(f"error.{name}", value) for name, value in values.items()})

    def actions(self, y: Vectors, observation: Any) -> Vectors:
        """Actions before their bounds, (..., m), from outputs y (..., m d + m) and observations (..., entries)."""
        error = np.asarray(observation)[..., list(self.places)].astype(np.float32) * np.float32(self.unit_mm)
        d = len(self.places)
        gains, offsets = np.split(y, [y.shape[-1] * d // (d + 1)], axis=-1)
        matrices = gains.reshape(*gains.shape[:-1], -1, d)
        size = np.sqrt((error * error).sum(-1, keepdims=True))
        linear = (matrices @ error[..., None])[..., 0] / np.float32(self.gain_mm)
        actions: Vectors = linear + offsets * size / (size + np.float32(self.scale_mm))
        return actions


@dataclass(frozen=True)
class GainNetwork(Network):
    """Fully connected layers without memory whose outputs become actions by a GainForm.

    Args:
        error: the form; the others are those of Network, of an observation that is a vector.
    Raises:
        PolicyError: as Network; or an observation in parts, or without the places of the error.
    """

    KIND = "gain"
    DESCRIBED: ClassVar[tuple[str, ...]] = (*Network.DESCRIBED, "error")

    error: GainForm

    def __post_init__(self) -> None:
        if self.inputs or max(self.error.places) >= self.entries:
            allowed = f"places of an observation in one part of {self.entries} entries"
            raise PolicyError("error.places", list(self.error.places), allowed)
        super().__post_init__()

    def description(self) -> dict[str, Any]:
        """Plain values, ready for JSON: the network without its arrays."""
        error = asdict(self.error) | {"places": list(self.error.places)}
        return {"kind": self.KIND} | super().description() | {"error": error}

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, Any], **described: Any) -> Self:
        """The network of these arrays and of `inputs`, `activation`, `output` and `error`; raises PolicyError."""
        return super().from_tensors(tensors, **described | {"error": GainForm.from_dict(described["error"])})

    def __call__(self, observation: Any) -> Vectors:
        """The deterministic action, (m,) or (B, m), each within [low, high]; raises PolicyError as Network does."""
        y = through(self.layers, ACTIVATIONS[self.activation], self.normalised(observation))
        return self._bounded(self.error.actions(y, self.vector(observation)))

    def _actions(self, width: int) -> int:
        if width % (len(self.error.places) + 1):
            raise PolicyError("outputs of the last layer", width, f"a multiple of {len(self.error.places) + 1}")
        return width // (len(self.error.places) + 1)
