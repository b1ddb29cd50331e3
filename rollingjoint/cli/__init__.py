"""The command `rj`.

Modules:
    case_options: the options that define an equilibrium, and that equilibrium.
    commands: the commands.
    extensions: commands that other packages add.
    identify: the command `rj identify`.
    loop_command: the command `rj loop`.
    mjcf: the option --mjcf of `rj export`.
    warmup_command: the command `rj warmup`.
"""

from rollingjoint.cli.commands import main

__all__ = ["main"]
