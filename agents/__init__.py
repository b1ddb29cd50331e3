"""Training, evaluation and comparison of controllers for the environments of rj_gym.

docs/cli.md lists the commands, docs/architecture.md the folders. Torch and Stable-Baselines3 are loaded by the modules
that need them.
"""

from rollingjoint import interrupts as _interrupts  # noqa: F401 (it handles Ctrl-C while a command is imported)
