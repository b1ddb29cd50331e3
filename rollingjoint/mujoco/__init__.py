"""Mechanisms as MuJoCo models (MJCF): an arm exactly, rolling chains by coupled joints, exact for circles.

Modules:
    arm: a hinge chain in space.
    chain: a planar chain of rolling links.
    coupling: a rolling contact as joints of MuJoCo.
    space: a chain in space of rolling contacts and hinges.
    walls: rigid walls around a chain.
    model: any mechanism; joint positions and accuracy of a planar chain.

The engine is not imported: this package alone writes a model.
"""

from rollingjoint.mujoco.model import Accuracy, accuracy, mjcf, positions

__all__ = ["Accuracy", "accuracy", "mjcf", "positions"]
