"""Quasi-static physics of tendon-driven rolling-joint and flexible-joint mechanisms. Units: mm, N, N·mm, rad."""

from rollingjoint._threads import set_threads
from rollingjoint.equilibrium import Equilibrium
from rollingjoint.errors import ConfigError, InvalidInput, MechanismError, RollingJointError, SolverError
from rollingjoint.hinge_chain import Bead, HingeChain
from rollingjoint.hinge_equilibrium import HingeEquilibrium
from rollingjoint.load import BodyWrench, Gravity, Spring, WorldForce
from rollingjoint.presets import PRESETS, five_link, flexible_arm, preset, small_arm, two_segment, uniform
from rollingjoint.profile import Profile, Surface
from rollingjoint.rolling_chain import Link, RollingChain
from rollingjoint.solution import Status
from rollingjoint.solve import solve_lengths, solve_lengths_batch, solve_tensions, solve_tensions_batch
from rollingjoint.tendon import BeadTendon, OnSurface, Tendon

__version__ = "0.1.0"

__all__ = [
    "PRESETS",
    "Bead",
    "BeadTendon",
    "BodyWrench",
    "ConfigError",
    "Equilibrium",
    "Gravity",
    "HingeChain",
    "HingeEquilibrium",
    "InvalidInput",
    "Link",
    "MechanismError",
    "OnSurface",
    "Profile",
    "RollingChain",
    "RollingJointError",
    "SolverError",
    "Spring",
    "Status",
    "Surface",
    "Tendon",
    "WorldForce",
    "five_link",
    "flexible_arm",
    "preset",
    "set_threads",
    "small_arm",
    "solve_lengths",
    "solve_lengths_batch",
    "solve_tensions",
    "solve_tensions_batch",
    "two_segment",
    "uniform",
]
