"""Fifty robots that nobody modelled: controllers know the nominal five-link chain and the ranges of Instrument-v0.

Modules:
    robot: the robots: what each of them is, and the table of all.
    contenders: controllers by name, file, run or policy.
    driving: one score per controller, with an interval over robots.
"""

from agents.robots.driving import RobotScore, score_on_robots
from agents.robots.robot import DEVELOPMENT, TEST_BED, Robot, robot, robot_table, robots

__all__ = ["DEVELOPMENT", "TEST_BED", "Robot", "RobotScore", "robot", "robot_table", "robots", "score_on_robots"]
