"""The error of policies."""

from rollingjoint.errors import InvalidInput


class PolicyError(InvalidInput):
    """A policy that cannot be exported, loaded or used."""
