"""The command `rj`.

Modules:
    case_options: the options that define an equilibrium, and that equilibrium.
    commands: the commands.
"""

from rollingjoint.cli.commands import main

__all__ = ["main"]
