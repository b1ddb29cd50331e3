"""Quasi-static physics of tendon-driven rolling-joint mechanisms. Units: mm, N, N·mm, rad."""

from rollingjoint._threads import set_threads
from rollingjoint.equilibrium import Equilibrium, Status
from rollingjoint.errors import ConfigError, InvalidInput, MechanismError, RollingJointError, SolverError
from rollingjoint.load import BodyWrench, Gravity, Spring, WorldForce
from rollingjoint.presets import PRESETS, five_link, preset, two_segment, uniform
from rollingjoint.profile import Profile, Surface
from rollingjoint.rolling_chain import Link, RollingChain
from rollingjoint.solve import solve_lengths, solve_lengths_batch, solve_tensions, solve_tensions_batch
from rollingjoint.tendon import OnSurface, Tendon

__version__ = "0.1.0"

__all__ = [
    "PRESETS",
    "BodyWrench",
    "ConfigError",
    "Equilibrium",
    "Gravity",
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
    "preset",
    "set_threads",
    "solve_lengths",
    "solve_lengths_batch",
    "solve_tensions",
    "solve_tensions_batch",
    "two_segment",
    "uniform",
]
