"""Score controllers on robots outside the training distribution: rj robots.

The command and the public names of agents.studies.robots.
"""

import sys

from agents.adaptation.driving import RobotScore, score_on_robots
from agents.adaptation.robot import DEVELOPMENT, TEST_BED, Robot, robot, robots
from agents.studies.robots import main, robot_table

__all__ = [
    "DEVELOPMENT",
    "TEST_BED",
    "Robot",
    "RobotScore",
    "robot",
    "robot_table",
    "robots",
    "score_on_robots",
]

if __name__ == "__main__":
    sys.exit(main())
