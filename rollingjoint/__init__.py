"""Quasi-static physics of tendon-driven rolling-joint and flexible-joint mechanisms. Units: mm, N, N·mm, rad.

Modules:
    _numba: everything that uses private interfaces of numba.
    cad: manufacturing files.
    camera: poses of links from photographs.
    chain: mechanisms, their equilibria, files and presets.
    checked_yaml: YAML files read strictly.
    checks: checks of single values.
    cli: the command `rj`.
    compiled: the interface of other packages to compiled code.
    design: design spaces, objectives and problems.
    differentiable: equilibria of planar chains as torch functions.
    errors: the exceptions.
    former_names: modules under earlier names, for pickles.
    friction: coefficients and state of friction.
    estimate: hidden numbers of a mechanism in operation, from its motors' measurements.
    identify: parameters of a mechanism from measurements.
    interrupts: Ctrl-C in commands.
    inverse: the lengths or tensions that bring a mechanism to a target.
    io: mechanisms as files, equilibria as tables and JSON.
    kernels: the compiled formulas and solvers.
    load: external loads and their tables.
    mujoco: mechanisms as MuJoCo models.
    plan: tendon lengths over time along a path of targets.
    plotting: pictures with matplotlib.
    profile: contact surfaces and their curvature.
    spatial: second opinions on arms.
    statics: the solvers, and derivatives.
    surroundings: walls, lumens and obstacles around planar chains.
    tables: tables as text and Markdown.
    threads: rows of a batch spread over threads.
    transmission: play, sheath and limits of tension between motors and tendons.
    warmup: all kernels compiled in advance, in several processes.
"""

from rollingjoint import interrupts as _interrupts  # noqa: F401 (first: it handles Ctrl-C while a command is imported)

# isort: split
from rollingjoint import former_names as _former_names  # noqa: F401
from rollingjoint.chain.equilibrium import Equilibrium, HingeEquilibrium
from rollingjoint.chain.hinge import Bead, HingeChain
from rollingjoint.chain.presets import (
    PRESETS,
    five_link,
    flexible_arm,
    pitch_yaw,
    pitch_yaw_two_segment,
    preset,
    small_arm,
    two_segment,
    uniform,
)
from rollingjoint.chain.rolling import Link, RollingChain
from rollingjoint.chain.spatial import SpatialChain, SpatialLink
from rollingjoint.chain.spatial_equilibrium import SpatialEquilibrium
from rollingjoint.chain.spatial_joints import PointHinge, RollingContact
from rollingjoint.chain.status import Status
from rollingjoint.chain.tendon import BeadTendon, OnSurface, SpaceTendon, Tendon
from rollingjoint.errors import ConfigError, InvalidInput, MechanismError, RollingJointError, SolverError
from rollingjoint.friction import CapstanFriction, FrictionState
from rollingjoint.inverse import Reach, ReachStatus, Workspace, all_solutions, reach, reach_batch, workspace
from rollingjoint.load.kinds import BodyWrench, Gravity, Spring, TorsionSpring, WorldForce
from rollingjoint.plan import Plan, PlanStatus, plan_path
from rollingjoint.profile import Profile, Surface
from rollingjoint.statics import sensitivity
from rollingjoint.statics.loop import Loop, trace_loop
from rollingjoint.statics.problem import Problem, prepare
from rollingjoint.statics.solve import solve_lengths, solve_lengths_batch, solve_tensions, solve_tensions_batch
from rollingjoint.statics.trace import trace
from rollingjoint.surroundings import (
    Bare,
    Capsule,
    Disc,
    HalfPlane,
    Lumen,
    Plane,
    Polygon,
    Sleeve,
    Sphere,
    Surroundings,
    Tube,
    WallFriction,
)
from rollingjoint.threads import set_threads

__version__ = "0.1.0"

__all__ = [
    "PRESETS",
    "Bare",
    "Bead",
    "BeadTendon",
    "BodyWrench",
    "CapstanFriction",
    "Capsule",
    "ConfigError",
    "Disc",
    "Equilibrium",
    "FrictionState",
    "Gravity",
    "HalfPlane",
    "HingeChain",
    "HingeEquilibrium",
    "InvalidInput",
    "Link",
    "Loop",
    "Lumen",
    "MechanismError",
    "OnSurface",
    "Plan",
    "PlanStatus",
    "Plane",
    "PointHinge",
    "Polygon",
    "Problem",
    "Profile",
    "Reach",
    "ReachStatus",
    "RollingChain",
    "RollingContact",
    "RollingJointError",
    "Sleeve",
    "SolverError",
    "SpaceTendon",
    "SpatialChain",
    "SpatialEquilibrium",
    "SpatialLink",
    "Sphere",
    "Spring",
    "Status",
    "Surface",
    "Surroundings",
    "Tendon",
    "TorsionSpring",
    "Tube",
    "WallFriction",
    "Workspace",
    "WorldForce",
    "all_solutions",
    "five_link",
    "flexible_arm",
    "pitch_yaw",
    "pitch_yaw_two_segment",
    "plan_path",
    "prepare",
    "preset",
    "reach",
    "reach_batch",
    "sensitivity",
    "set_threads",
    "small_arm",
    "solve_lengths",
    "solve_lengths_batch",
    "solve_tensions",
    "solve_tensions_batch",
    "trace",
    "trace_loop",
    "two_segment",
    "uniform",
    "workspace",
]
