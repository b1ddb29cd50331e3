"""A checker of Gymnasium vector environments: does one keep the contract of gymnasium.vector.VectorEnv?"""

from rj_gym.vector_checker.check import CHECKS, check_vector_env
from rj_gym.vector_checker.report import Outcome, Report, VectorEnvError

__all__ = ["CHECKS", "Outcome", "Report", "VectorEnvError", "check_vector_env"]
