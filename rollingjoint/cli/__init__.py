"""The command `rj`.

Modules:
    case_options: the options that define an equilibrium, and that equilibrium.
    commands: the commands.
    identify: the command `rj identify`.
    loop_command: the command `rj loop`.
"""

from rollingjoint.cli.commands import main

__all__ = ["main"]
