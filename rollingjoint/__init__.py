"""Quasi-static physics of tendon-driven rolling-joint and flexible-joint mechanisms. Units: mm, N, N·mm, rad."""

from rollingjoint.errors import ConfigError, InvalidInput, MechanismError, RollingJointError, SolverError
from rollingjoint.load import BodyWrench, Gravity, Spring, TorsionSpring, WorldForce
from rollingjoint.planar.chain import Link, RollingChain
from rollingjoint.planar.equilibrium import Equilibrium
from rollingjoint.presets import PRESETS, five_link, flexible_arm, preset, small_arm, two_segment, uniform
from rollingjoint.profile import Profile, Surface
from rollingjoint.solution import Status
from rollingjoint.spatial.chain import Bead, HingeChain
from rollingjoint.spatial.equilibrium import HingeEquilibrium
from rollingjoint.statics import sensitivity
from rollingjoint.statics.solve import solve_lengths, solve_lengths_batch, solve_tensions, solve_tensions_batch
from rollingjoint.tendon import BeadTendon, OnSurface, Tendon
from rollingjoint.threads import set_threads

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
    "TorsionSpring",
    "WorldForce",
    "five_link",
    "flexible_arm",
    "preset",
    "sensitivity",
    "set_threads",
    "small_arm",
    "solve_lengths",
    "solve_lengths_batch",
    "solve_tensions",
    "solve_tensions_batch",
    "two_segment",
    "uniform",
]
