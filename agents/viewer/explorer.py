"""A mechanism under inputs that a person sets: its equilibrium, quantities derived from it, and files of it."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from agents.viewer.around import NO_WALLS, Around, WallScene, scenes
from agents.viewer.solids import DEPTH, grid_solid, slab
from rollingjoint import (
    PRESETS,
    CapstanFriction,
    Profile,
    RollingChain,
    SpatialChain,
    Surface,
    WorldForce,
    solve_lengths,
    solve_tensions,
    solve_tensions_batch,
)
from rollingjoint.errors import InvalidInput
from rollingjoint.io import report
from rollingjoint.io.mechanism_file import dump_mechanism
from rollingjoint.plotting.walls import in_world
from rollingjoint.plotting.walls_in_space import in_world as in_world_in_space
from rollingjoint.plotting.walls_in_space import wall_surfaces
from rollingjoint.surroundings import wall_strips
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]

TENSIONS, LENGTHS = "tensions", "lengths"
INPUTS = (TENSIONS, LENGTHS)
HIGHEST = 15.0  # N, of every tendon
MOST_PULL = 0.25  # of the length of the mechanism, that a tendon is pulled in or paid out
REACHED = 11  # binary logarithm of the number of tensions tried for the reach of the tip
SHARE = 0.2  # of the length of the mechanism, at most, that the force of the ellipses moves the tip
FORCES = np.outer(10.0 ** np.arange(-6, 4), (1.0, 2.0, 5.0)).ravel()  # N, to choose that force from
TURN = 64  # points of an ellipse


@dataclass(frozen=True)
class Inputs:
    """The inputs that a person sets.

    Args:
        drive: TENSIONS or LENGTHS. tensions: (m,) [N]. pulls: (m,), distances below the neutral lengths [mm].
        link: the force acts on its origin. force: in the base frame, (2,) or (3,) [N].
        friction: coefficient in all holes. curvatures: factors of the curvature of the contact surfaces,
            below and above joint 0 first, (2 J,); none for arms.
        around: the walls around the chain.
    """

    drive: str
    tensions: tuple[float, ...]
    pulls: tuple[float, ...]
    link: int
    force: tuple[float, ...]
    friction: float
    curvatures: tuple[float, ...]
    around: Around = field(default_factory=Around)


class Explorer:
    """A mechanism under inputs that change; where tendons rub, every equilibrium remembers the one before.

    Args:
        mechanism: of either class. name: of the preset or file that it comes from.
        files: scenes of files of surroundings, by name.
    """

    def __init__(self, mechanism: Any, name: str = "", files: Mapping[str, WallScene] | None = None) -> None:
        self.nominal, self.name = mechanism, name or mechanism.name or "mechanism"
        self.flat, self.in_space = isinstance(mechanism, RollingChain), isinstance(mechanism, SpatialChain)
        self.scenes = scenes(mechanism, files)
        self.jumped = False  # in the last change
        self.inputs = self._neutral()
        self.mechanism = mechanism
        self.found: Any = None
        self.usable: Any = None  # the last usable equilibrium
        self.solve()

    @classmethod
    def preset(cls, name: str) -> Explorer:
        """One of the mechanisms that come with the package."""
        return cls(PRESETS[name](), name)

    def change(self, **changes: Any) -> None:
        """Set inputs and find the equilibrium; walls and base get there in steps.

        Raises:
            MechanismError: there is no such chain. InvalidInput: there are no such walls, or one would pass through the
                chain on its way. The state is unchanged.
        """
        inputs = replace(self.inputs, **(self._held(changes.get("drive")) | changes))
        before, after = self.inputs.around, inputs.around
        scene = self.scenes.get(after.walls)
        if scene is not None:
            scene.walls(after)
        if (inputs.friction, inputs.curvatures) != (self.inputs.friction, self.inputs.curvatures):
            self.mechanism = self._built(inputs)
            self.usable = None  # another mechanism has no history
        moves = scene if before.walls == after.walls else None
        count = 1 if moves is None else moves.steps(before, after)
        kept = self.inputs, self.found, self.usable, self.jumped
        self.jumped = False
        for step in range(1, count + 1):
            way = after if step == count else before.on_the_way(after, step / count)
            try:
                if moves is not None:
                    moves.check_way(self.inputs.around, way, self.places)
            except InvalidInput:
                self.inputs, self.found, self.usable, self.jumped = kept
                raise
            self.inputs = replace(inputs, around=way)
            self.solve(begin=before.walls != after.walls)

    def solve(self, begin: bool = False) -> None:
        """Find the equilibrium of the inputs from the last usable one; begin: without a history of friction."""
        among = self._among()
        arguments: dict[str, Any] = {"start": self.usable, **among}
        if self.mechanism.has_friction or (among and among["surroundings"].has_friction):
            fresh = begin or self.usable is None
            arguments = among | {"history": self._solved([], **arguments) if fresh else self.usable}
        self.found = self._solved(self.loads, **arguments)
        self.usable = self.found if self.found.ok else self.usable
        self.jumped = not begin and (self.jumped or (self.found.walls is not None and bool(self.found.jumped)))

    def _solved(self, loads: Sequence[WorldForce], **arguments: Any) -> Any:
        if self.inputs.drive == TENSIONS:
            return solve_tensions(self.mechanism, self.inputs.tensions, loads, **arguments)
        return solve_lengths(self.mechanism, self.lengths, loads, **arguments)

    def _among(self) -> dict[str, Any]:
        """The arguments of solvers for the walls."""
        around = self.inputs.around
        if around.walls == NO_WALLS:
            return {}
        scene = self.scenes[around.walls]
        return {"surroundings": scene.walls(around), "base": scene.base_at(around)}

    @property
    def scene(self) -> WallScene | None:
        """The scene that is around the chain."""
        return self.scenes.get(self.inputs.around.walls)

    def in_world(self, points: Array, turned_only: bool = False) -> Array:
        """Points in the frame of the base, or vectors there, (..., d), in the frame of the walls."""
        if self.scene is None:
            return points
        turn, origin = self.scene.frame_at(self.inputs.around)
        return np.asarray(points) @ turn.T + (0.0 if turned_only else origin)

    def in_base(self, vector: Array) -> Array:
        """A vector (2,) or (3,) in the frame of the walls, in the frame of the base."""
        return vector if self.scene is None else np.asarray(vector @ self.in_world(np.eye(len(vector)), True).T)

    def poses(self, equilibrium: Any) -> Array:
        """The poses of the links among the walls, where the equilibrium has the base."""
        if equilibrium.walls is None:
            return np.asarray(equilibrium.poses)
        return np.asarray((in_world if self.flat else in_world_in_space)(equilibrium).poses)

    @property
    def places(self) -> Array:
        """Origins of the links of the last usable equilibrium among the walls, (n, 2 or 3) [mm]."""
        poses = self.poses(self.found if self.usable is None else self.usable)
        return poses[:, :2] if self.flat else poses[:, :3, 3]

    @property
    def wall_solids(self) -> list[tuple[Array, NDArray[np.uint32]]]:
        """Vertices [mm] and faces of the walls among which the mechanism is: as deep as planar links, or surfaces."""
        if self.found.walls is None:
            return []
        walls, which = self.found.walls.walls, int(self.found.walls.which)
        if not self.flat:
            return [grid_solid(grid) for grid in wall_surfaces(walls, which, self.places)]
        depth = DEPTH * float(self.mechanism.length)
        return [slab(*strip, depth) for strip in wall_strips(walls, which, self.places)]

    @property
    def wall_arrows(self) -> list[tuple[Array, Array, bool]]:
        """Place, force on the link and whether it sticks, of every contact with a wall [mm, N]."""
        if self.found.walls is None or not self.found.ok:
            return []
        return [
            (self.in_world(touch.place), self.in_world(touch.force_on_link, turned_only=True), touch.sticks)
            for touch in self.found.wall_contacts
        ]

    @property
    def wall_line(self) -> str:
        """Contact with the walls, in a line; empty without walls."""
        if self.found.walls is None or not self.found.ok:
            return ""
        touches, push = self.found.wall_contacts, f"{self.found.insertion_force + 0.0:.2f} N push the base"
        jump = "⚠ **jumped** to another pose" if self.jumped else ""
        if not touches:
            return ", ".join(filter(None, [jump, f"no link touches a wall, the nearest {self._nearest():.1f} mm away"]))
        deepest, strongest = min(touch.gap for touch in touches), max(touch.force for touch in touches)
        sticking = sum(touch.sticks for touch in touches)
        rubbing = f"{sticking} stick, {len(touches) - sticking} slip" if self.found.walls.memory is not None else ""
        contacts = f"**{len(touches)} contact{'s' * (len(touches) > 1)}**"
        forces = f"at most {strongest:.2f} N and {-deepest:.2f} mm deep"
        return ", ".join(filter(None, [jump, contacts, forces, rubbing, push]))

    def _nearest(self) -> float:
        """The smallest gap [mm]."""
        return float(self.found.wall_gaps.min(initial=np.inf))

    @property
    def wall_table(self) -> list[list[str]]:
        """Link, wall, gap [mm], normal force and friction [N] of every contact, and whether it sticks."""
        if self.found.walls is None or not self.found.ok:
            return []
        return [
            [str(touch.link), f"{touch.kind} {touch.wall}"]
            + [f"{value + 0.0:.3f}" for value in (touch.gap, touch.force, touch.friction)]
            + ["sticks" if touch.sticks else "slips" if self.found.walls.memory is not None else ""]
            for touch in self.found.wall_contacts
        ]

    @property
    def loads(self) -> list[WorldForce]:
        """The force, if there is one."""
        force: Any = self.inputs.force
        return [WorldForce(self.inputs.link, force)] if any(force) else []

    @property
    def lengths(self) -> Array:
        """Tendon lengths that the motors command, (m,) [mm]."""
        return np.asarray(self.nominal.neutral_lengths - np.array(self.inputs.pulls))

    @property
    def headline(self) -> str:
        """The status of the solve, in a line; of a usable result also its smallest eigenvalue and margins."""
        if not self.found.ok:
            return f"⚠ **{self.found.status.name}**: {self.found.status.message}"
        parts = [f"**{self.found.status.name}**", f"smallest eigenvalue {self.found.smallest_eigenvalue:.3g} N·mm"]
        if self.flat:
            parts.append(f"slip margin {self.found.slip_margins().min():.2f} N")
            parts.append(f"pressing margin {self.found.pressing_margins.min():.2f} N")
        if self.in_space:
            parts.append(f"tilting margin {self.found.tilting_margins.min():.2f} N")
            parts.append(f"friction required {self.found.friction_required.max():.2f}")
        return ", ".join(parts)

    @property
    def table(self) -> str:
        """All numbers of the equilibrium, as `rj solve` prints them."""
        return report.as_table(self.found)

    @property
    def has_contacts(self) -> bool:
        """Whether its joints are contacts; hinges have none."""
        return self.flat or self.in_space

    @property
    def contact_arrows(self) -> Array:
        """Contact forces on the distal links as arrows, (k, 2, d): from, by [mm, N]; none at hinges.

        One at each contact of a planar chain, in space one at each end of a contact line.
        """
        if self.in_space and self.found.ok:
            return self._end_arrows()
        if not self.flat or not self.found.ok:
            return np.zeros((0, 2, 2))
        tangents = self.found.contact_tangents
        normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=-1)
        forces = self.found.contact_forces
        by = forces[:, :1] * tangents + forces[:, 1:] * normals
        return np.stack([self.in_world(self.found.contact_points), self.in_world(by, turned_only=True)], axis=1)

    def _end_arrows(self) -> Array:
        frames, ends = self.found.contact_frames[:, None], self.found.end_forces
        reach = np.array([joint.line for joint in self.mechanism.joints])[:, None] * [1.0, -1.0]
        begins = self.found.contact_points[:, None] + reach[..., None] * frames[..., 2, :]
        axial = np.broadcast_to(0.5 * self.found.reactions[:, None, 2:3], (*reach.shape, 1))
        forces = (np.concatenate([ends, axial], axis=-1)[..., None, :] @ frames)[..., 0, :]
        arrows = self.in_world(begins), self.in_world(forces, turned_only=True)
        return np.stack(arrows, axis=-2)[np.isfinite(reach)]

    @property
    def compliance(self) -> Array:
        """Displacement of the tip per force, (d, d) [mm/N]; NaN where it is not defined."""
        size = len(self.inputs.force)
        if not self.found.ok:
            return np.full((size, size), np.nan)
        free = self.found.free_joints
        moves = self.found.point_jacobian(self.mechanism.n_links - 1)[:size][:, free]
        stiffness = self.found.stiffness[np.ix_(free, free)]
        return np.asarray(moves @ np.linalg.solve(stiffness, moves.T))

    def ellipses(self) -> tuple[float, list[Array]]:
        """A force [N], and the tip under it in every direction of a plane, (TURN, d) [mm] for each plane."""
        compliance = self.compliance
        largest = np.linalg.norm(compliance, 2) if np.isfinite(compliance).all() else 0.0
        fitting = FORCES[largest * FORCES < SHARE * self.mechanism.length] if largest > 0.0 else []
        if not len(fitting):
            return 0.0, []
        turns, size = np.linspace(0.0, 2 * np.pi, TURN), len(compliance)
        circles = np.zeros((size if size > 2 else 1, TURN, size))
        for first, circle in enumerate(circles):
            circle[:, first], circle[:, (first + 1) % size] = np.cos(turns), np.sin(turns)
        return float(fitting[-1]), [
            self.in_world(circle) for circle in self.found.tip + fitting[-1] * circles @ compliance.T
        ]

    def reached(self) -> Array:
        """Points that the tip reaches under the load with any tensions up to HIGHEST, without friction, (N, d) [mm].

        Among walls each is the equilibrium that is found from the present one.
        """
        mechanism = self.mechanism.replace(friction=None) if self.mechanism.has_friction else self.mechanism
        tensions = HIGHEST * qmc.Sobol(mechanism.n_tendons, scramble=False).random_base2(REACHED)
        among = self._among()
        starts = {"starts": self.usable.joint_angles} if among and self.usable is not None else {}
        equilibria = solve_tensions_batch(mechanism, tensions, self.loads, **starts, **among)
        return self.in_world(np.asarray(equilibria.tip[np.asarray(equilibria.ok)]))

    @property
    def python(self) -> str:
        """A program that solves the same; with friction, from a state without a history."""
        call = "solve_tensions" if self.inputs.drive == TENSIONS else "solve_lengths"
        values = self.inputs.tensions if self.inputs.drive == TENSIONS else self.lengths
        loads = f", [WorldForce({self.inputs.link}, {_numbers(self.inputs.force)})]" if self.loads else ""
        source = f"{self.name}()" if self._is_preset else f"load_mechanism({json.dumps(self.file_name)})"
        among, lines, rubs = self._among(), [], self.mechanism.has_friction
        names = [*(["WorldForce"] if loads else []), *([self.name] if self._is_preset else []), call]
        more = ""
        if among:
            around = among["surroundings"]
            parts = [around, around.outline, *around.walls, around.friction, *(wall.friction for wall in around.walls)]
            names += [type(each).__name__ for each in parts if each is not None]
            lines += [f"around = {around!r}", f"near = {_numbers(self.found.joint_angles)}"]
            more = f", surroundings=around, base={_numbers(among['base'])}"
            rubs = rubs or around.has_friction
        start = ", start=near" if among else ""
        imports = [f"from rollingjoint import {', '.join(dict.fromkeys(names))}"]
        imports += [] if self._is_preset else ["from rollingjoint.io.mechanism_file import load_mechanism"]
        lines = [*imports, "", f"mechanism = {source}", *lines]
        if rubs:
            lines += [f"begun = {call}(mechanism, {_numbers(values)}{more}{start})"]
        history = ", history=begun" if rubs else start
        lines += [f"found = {call}(mechanism, {_numbers(values)}{loads}{more}{history})"]
        return "\n".join([*lines, "print(found.status.message, found.tip)", ""])

    @property
    def file_name(self) -> str:
        """The name of the mechanism's file."""
        return f"{self.name}.yaml"

    @property
    def yaml(self) -> str:
        """The mechanism as a file."""
        return dump_mechanism(self.mechanism)

    def workshop_files(self, kind: str) -> bytes:
        """An archive of the parts as "stl" or "dxf".

        Raises:
            MechanismError: a part that cannot be made. InvalidInput: a package that is missing.
        """
        from rollingjoint.cad import export

        with tempfile.TemporaryDirectory() as folder:
            files = export(self.mechanism, Path(folder) / "parts", [kind])
            return _archive(files)

    @cached_property
    def _surfaces(self) -> list[tuple[int, str]]:
        """Link and side of every contact surface, in the order of Inputs.curvatures."""
        joints = range(self.nominal.n_joints if self.flat else 0)
        return [place for joint in joints for place in ((joint, "child"), (joint + 1, "parent"))]

    @property
    def surface_names(self) -> list[str]:
        """The names of the contact surfaces, in the order of Inputs.curvatures."""
        return [f"Link {link}, {'top' if side == 'child' else 'bottom'}" for link, side in self._surfaces]

    @property
    def _is_preset(self) -> bool:
        neutral = self._neutral()
        same = (self.inputs.friction, self.inputs.curvatures) == (neutral.friction, neutral.curvatures)
        return same and self.name in PRESETS

    def _held(self, drive: str | None) -> dict[str, Any]:
        """The inputs of another drive that hold the mechanism in its present equilibrium."""
        if drive is None or drive == self.inputs.drive or not self.found.ok:
            return {}
        if drive == TENSIONS:
            return {"tensions": tuple(self.found.tensions.tolist())}
        commanded = unstretched_length(self.found.lengths, self.found.tensions, self.mechanism.stiffnesses)
        return {"pulls": tuple((self.nominal.neutral_lengths - commanded).tolist())}

    def _neutral(self) -> Inputs:
        m, size = self.nominal.n_tendons, 2 if self.flat else 3
        factors = (1.0,) * len(self._surfaces)
        return Inputs(TENSIONS, (3.0,) * m, (0.0,) * m, self.nominal.n_links - 1, (0.0,) * size, self._rubs(), factors)

    def _rubs(self) -> float:
        return float(self.nominal.friction.mu) if self.nominal.friction is not None else 0.0

    def _built(self, inputs: Inputs) -> Any:
        """The nominal mechanism with the friction and the curvatures of inputs."""
        changes: dict[str, Any] = {}
        if inputs.friction != self._rubs():
            changes["friction"] = CapstanFriction(inputs.friction) if inputs.friction > 0.0 else None
        if any(factor != 1.0 for factor in inputs.curvatures):
            links = list(self.nominal.links)
            for (link, side), factor in zip(self._surfaces, inputs.curvatures, strict=True):
                links[link] = replace(links[link], **{side: _curved(getattr(links[link], side), factor)})
            changes["links"] = tuple(links)
        return self.nominal.replace(**changes) if changes else self.nominal


def _curved(surface: Surface, factor: float) -> Surface:
    profile = surface.profile
    return replace(surface, profile=Profile(profile.breaks, factor * profile.coefficients))


def _numbers(values: Iterable[float]) -> str:
    return f"({', '.join(f'{value:.12g}' for value in values)})"


def _archive(files: Sequence[Path]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            archive.write(file, file.name)
    return packed.getvalue()
