"""A checker of Gymnasium vector environments: does one keep the contract of gymnasium.vector.VectorEnv?

Modules:
    autoreset: checks of the autoreset modes.
    check: the table of checks, and the function that runs them.
    episodes: checks of time limits, and against scalar environments.
    interface: checks of attributes, spaces and types.
    memory: checks that returned objects are not used again.
    probe: the environment under test, with rollouts that checks share.
    report: the report and its table.
    seeding: checks of seeds and random numbers.
    values: comparison of nested values.
"""

from rj_gym.vector_checker.check import CHECKS, check_vector_env
from rj_gym.vector_checker.report import Outcome, Report, VectorEnvError

__all__ = ["CHECKS", "Outcome", "Report", "VectorEnvError", "check_vector_env"]
