"""The command `rj`.

Modules:
    camera_command: the command `rj camera`.
    case_options: the options that define an equilibrium, and its solve.
    commands: the commands.
    extensions: commands of other packages.
    identify: the command `rj identify`.
    loop_command: the command `rj loop`.
    mjcf: the option --mjcf of `rj export`.
    plan_command: the command `rj plan`.
    reach_command: the command `rj reach`.
    trace_command: the command `rj trace`.
    warmup_command: the command `rj warmup`.
    workspace_command: the command `rj workspace`.
"""

from rollingjoint.cli.commands import main

__all__ = ["main"]
