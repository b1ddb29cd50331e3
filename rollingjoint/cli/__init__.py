"""The command `rj`."""

from rollingjoint.cli.commands import main

__all__ = ["main"]
