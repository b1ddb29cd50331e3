"""The network in a policy file, from plain values and arrays; errors that name the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from agents.policies.base import PolicyNetwork
from agents.policies.errors import PolicyError
from agents.policies.gain import GainNetwork
from agents.policies.network import Network
from agents.policies.recurrent import RecurrentNetwork
from agents.policies.stacked import StackedNetwork
from agents.runs.checks import choice, prefixed
from rollingjoint.checked_yaml import mapping

NETWORKS: tuple[type[PolicyNetwork], ...] = (Network, GainNetwork, StackedNetwork, RecurrentNetwork)
KINDS = {kind.KIND: kind for kind in NETWORKS}


def network_in(described: Any, tensors: Mapping[str, Any]) -> PolicyNetwork:
    """The network of this description; without `kind`, as in the first policy files, a Network."""
    kind = choice(*KINDS)("network.kind", described.get("kind", Network.KIND))
    described = mapping("network", described, ("kind", *KINDS[kind].DESCRIBED), KINDS[kind].DESCRIBED)
    return KINDS[kind].from_tensors(tensors, **{name: described[name] for name in KINDS[kind].DESCRIBED})


@contextmanager
def located(source: str) -> Iterator[None]:
    """A context that turns every error about the content of a file into a PolicyError that names the file."""
    try:
        with prefixed(f"{source}: ", PolicyError):
            yield
    except PolicyError:
        raise
    except Exception as error:  # any error of unexpected values, such as 1e999
        raise PolicyError(source, f"{type(error).__name__}: {error}", "the content of a policy file") from error
