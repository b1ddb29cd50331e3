"""Settings of the tasks among walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from rj_gym.core.settings import LONGEST_EPISODE, Range, Settings
from rollingjoint.chain.presets import five_link, two_segment
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checks import as_boolean, as_choice, as_integer, as_number, as_range
from rollingjoint.errors import ConfigError
from rollingjoint.surroundings import WallFriction
from rollingjoint.surroundings.walls import LARGEST_WALL_FRICTION, STIFFNESSES

POSES = ("all", "tip", "none")
"""What of the instrument's pose is observed."""


def instrument() -> RollingChain:
    """Eight moving links of 10 mm in two segments, four tendons."""
    return two_segment(4, 4, height=10.0, radius=7.0, half_width=5.0)


@dataclass(frozen=True)
class WallRewardConfig(Settings):
    """Weights of the reward.

    Args:
        error_scale_mm: way to the target that counts as 1 in a step [mm].
        progress: reward of 1 mm less of the way.
        force: of 1 N above `free_force`, of the contact that presses most.
        free_force: force that costs nothing [N].
        smoothness: of the mean square change of the action.
        failure_penalty: subtracted where a step finds no usable pose and ends the episode.
    """

    _SECTION: ClassVar[str] = "reward."
    error_scale_mm: float = 20.0
    progress: float = 0.5
    force: float = 0.3
    free_force: float = 0.2
    smoothness: float = 0.01
    failure_penalty: float = 100.0

    def __post_init__(self) -> None:
        self._check(as_number, "error_scale_mm", low=1e-3)
        self._check(as_number, "progress", "force", "free_force", "smoothness", "failure_penalty", low=0.0)


@dataclass(frozen=True)
class NoiseConfig(Settings):
    """Standard deviations of the errors of sensors, new in every step; only observations have them.

    Args:
        position_mm: of links' places [mm].
        angle: of links' angles [rad].
        tension: of tendons [N].
        force: of the insertion force [N].
    """

    _SECTION: ClassVar[str] = "noise."
    position_mm: float = 0.0
    angle: float = 0.0
    tension: float = 0.0
    force: float = 0.0

    def __post_init__(self) -> None:
        self._check(as_number, "position_mm", "angle", "tension", "force", low=0.0)


@dataclass(frozen=True)
class SurroundingsConfig(Settings):
    """The settings that every task among walls has.

    Args:
        mechanism: preset name, mechanism file, or a RollingChain.
        sleeve: radius of the skin with which links touch walls [mm].
        episode_steps: steps until the episode is truncated.
        action_scale_mm: tendon length pulled in by an action of 1 [mm per step].
        tension_range: minimum and maximum tendon tension [N]; at a limit the command follows the tendon.
        start_tension: of every tendon at the start [N].
        presliding: slip over which the friction of walls builds up [mm].
        poses: what of the pose is observed: "all" links, the "tip", or "none".
        success_mm: largest tip error of a success [mm].
        force_limit: largest force of any contact, at any time, of a success [N].
        reward, noise: nested settings, each also a dictionary.
    Raises:
        ConfigError: a value out of range, with the range.
    """

    FEEDS: ClassVar[bool] = False  # whether the base moves on, by one more entry of the action
    mechanism: str | RollingChain = field(default_factory=instrument)
    sleeve: float = 4.5
    episode_steps: int = 60
    action_scale_mm: float = 1.0
    tension_range: Range = (0.5, 15.0)
    start_tension: float = 3.0
    presliding: float = 0.05
    poses: str = "all"
    success_mm: float = 3.0
    force_limit: float = 2.0
    reward: WallRewardConfig = field(default_factory=WallRewardConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)

    def __post_init__(self) -> None:
        if not isinstance(self.mechanism, str | RollingChain):
            raise ConfigError("mechanism", self.mechanism, "a preset name, a mechanism file or a RollingChain")
        self._check(as_number, "sleeve", low=0.1, high=100.0)
        self._check(as_integer, "episode_steps", low=1, high=LONGEST_EPISODE)
        self._check(as_number, "action_scale_mm", low=1e-6, high=5.0)
        self._check(as_range, "tension_range", low=0.0, unit="N")
        low, high = self.tension_range
        if low == high:
            raise ConfigError("tension_range", self.tension_range, "two different tensions (low, high) [N]")
        self._check(as_number, "start_tension", low=max(low, 1e-3), high=high)
        self._check(as_number, "presliding", low=0.01, high=10.0)
        self._check(as_choice, "poses", choices=POSES)
        self._check(as_number, "success_mm", "force_limit", low=1e-3)
        self._check_nested({"reward": WallRewardConfig, "noise": NoiseConfig})

    def _check_law(self) -> None:
        """Check the fields `stiffness`, a range, and `mu` of walls."""
        self._check(as_range, "stiffness", low=STIFFNESSES[0], high=STIFFNESSES[1], unit="N/mm")
        self._check(as_number, "mu", low=0.0, high=LARGEST_WALL_FRICTION)

    def friction(self, mu: float) -> WallFriction | None:
        """Friction of walls with this coefficient."""
        return WallFriction(mu, self.presliding) if mu > 0.0 else None


@dataclass(frozen=True)
class LumenFamily:
    """Random lumens: straight, then bends with straight pieces between them, then straight again.

    Args:
        bends: number of bends.
        radius: of the lumen [mm].
        bend_radius: range of the radii of bends, uniform [mm].
        angles: range of the turn of every bend, the first, the second, ...; of later ones the last range [rad].
        between: range of the straight lengths between bends [mm].
        stiffness: range of the walls' stiffness [N/mm]. mu: coefficient of friction.
    """

    bends: int
    radius: float
    bend_radius: Range
    angles: tuple[Range, ...]
    stiffness: Range
    mu: float
    between: Range = (3.0, 10.0)


_HARD = LumenFamily(2, 6.0, (20.0, 30.0), ((0.7, 1.4), (0.6, 1.3)), (1.0, 5.0), 0.3)

FAMILIES = {
    "hard": _HARD,
    "gentle": LumenFamily(2, 7.5, (28.0, 45.0), ((0.5, 1.2), (0.4, 1.0)), (0.5, 2.0), 0.15),
    "tight": LumenFamily(2, 5.0, _HARD.bend_radius, _HARD.angles, _HARD.stiffness, 0.3),
    "stiff": LumenFamily(2, 6.0, _HARD.bend_radius, _HARD.angles, (10.0, 10.0), 0.3),
    "three_bends": LumenFamily(3, 6.0, _HARD.bend_radius, ((0.5, 0.9),), _HARD.stiffness, 0.3),
}
"""Families of lumens by name. With a sleeve of 4.5 mm, "hard" has 1.5 mm of play and "tight" 0.5 mm."""


@dataclass(frozen=True)
class LumenConfig(SurroundingsConfig):
    """Everything that defines the lumen task.

    Args:
        families: names of FAMILIES; each episode draws one of them.
        radius, stiffness, mu: of all lumens in place of their family's; None: the family's [mm, N/mm (a range), 1].
        depth: range of the target's place beyond the beginning of the first bend, along the centre line [mm].
        feed_scale_mm: how far an action of 1 moves the base on [mm per step].
        feed_range: of the base [mm].
        walls: "none" of the lumen is observed, or the centre line "ahead", six points up to 40 mm from the tip.
    """

    FEEDS: ClassVar[bool] = True
    families: Sequence[str] = ("hard",)
    radius: float | None = None
    stiffness: Range | None = None
    mu: float | None = None
    depth: Range = (45.0, 70.0)
    feed_scale_mm: float = 2.0
    feed_range: Range = (0.0, 75.0)
    walls: str = "none"

    def __post_init__(self) -> None:
        super().__post_init__()
        names = (self.families,) if isinstance(self.families, str) else self.families
        if not isinstance(names, Sequence) or not names or not all(isinstance(name, str) for name in names):
            raise ConfigError("families", self.families, f"a list of names among {', '.join(FAMILIES)}")
        self._set("families", tuple(as_choice("families", name, tuple(FAMILIES), ConfigError) for name in names))
        if self.radius is not None:
            self._check(as_number, "radius", low=self.sleeve, high=15.0)
        if self.stiffness is not None:
            self._check(as_range, "stiffness", low=STIFFNESSES[0], high=STIFFNESSES[1], unit="N/mm")
        if self.mu is not None:
            self._check(as_number, "mu", low=0.0, high=LARGEST_WALL_FRICTION)
        if not self._rubs_alike:
            raise ConfigError("mu", self.mu, "0 for all lumens or above 0 for all", "Set mu, or take other families.")
        narrowest = min(self.family_radius(name) for name in self.families)
        if narrowest <= self.sleeve:
            raise ConfigError("sleeve", self.sleeve, f"less than {narrowest:g} mm, the radius of the narrowest lumen")
        self._check(as_range, "depth", low=0.0, high=200.0, unit="mm")
        self._check(as_number, "feed_scale_mm", low=1e-6, high=10.0)
        self._check(as_range, "feed_range", low=0.0, high=1000.0, unit="mm")
        if self.feed_range[0] > 0.0 or self.feed_range[1] == 0.0:
            allowed = "a range from 0, where the base starts, to a number above 0 [mm]"
            raise ConfigError("feed_range", self.feed_range, allowed)
        self._check(as_choice, "walls", choices=("none", "ahead"))

    def family_radius(self, name: str) -> float:
        """Radius of the lumens of a family [mm]."""
        return FAMILIES[name].radius if self.radius is None else self.radius

    def family_mu(self, name: str) -> float:
        """Coefficient of friction of the lumens of a family."""
        return FAMILIES[name].mu if self.mu is None else self.mu

    @property
    def most_bends(self) -> int:
        """The largest number of bends of an episode."""
        return max(FAMILIES[name].bends for name in self.families)

    @property
    def _rubs_alike(self) -> bool:
        return len({self.family_mu(name) > 0.0 for name in self.families}) == 1


@dataclass(frozen=True)
class ObstaclesConfig(SurroundingsConfig):
    """Everything that defines the task among obstacles.

    Args:
        discs: number of discs.
        disc_radius: range of their radii [mm].
        stiffness: range of their stiffness [N/mm].
        mu: their coefficient of friction.
        reach_mm: least distance of the target from the tip at the start [mm].
        search: how closely it is looked whether ways are clear of discs: "coarse" or "fine", see ObstaclesV1Env.
    """

    discs: int = 2
    disc_radius: Range = (3.0, 6.0)
    stiffness: Range = (2.0, 2.0)
    mu: float = 0.1
    reach_mm: float = 25.0
    search: str = "coarse"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(as_integer, "discs", low=1, high=8)
        self._check(as_range, "disc_radius", low=0.5, high=30.0, unit="mm")
        self._check_law()
        self._check(as_number, "reach_mm", low=0.0, high=40.0)
        self._check(as_choice, "search", choices=("coarse", "fine"))


@dataclass(frozen=True)
class ObstaclesV1Config(ObstaclesConfig):
    """As ObstaclesConfig, with episodes that are drawn faster: see ObstaclesV1Env."""

    search: str = "fine"


@dataclass(frozen=True)
class HiddenWallConfig(SurroundingsConfig):
    """Everything that defines the task at a hidden wall.

    Args:
        goal: "touch": press with `touch_force` at the target's place on the wall; "reach": a target along the wall.
        touch_force: force of the tip at the target [N].
        force_margin: how far from it the force of a success may be [N].
        stiffness: range of the wall's stiffness, log-uniform [N/mm].
        mu: its coefficient of friction.
        observe_force: whether the observation has the normal force of the wall.
    """

    mechanism: str | RollingChain = field(default_factory=five_link)
    sleeve: float = 8.0
    poses: str = "none"
    force_limit: float = 1.0
    goal: str = "touch"
    touch_force: float = 0.5
    force_margin: float = 0.2
    stiffness: Range = (1.0, 10.0)
    mu: float = 0.0
    observe_force: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(as_choice, "goal", choices=("touch", "reach"))
        self._check(as_number, "touch_force", "force_margin", low=1e-3)
        self._check_law()
        self._check(as_boolean, "observe_force")
        if self.touch_force > self.force_limit:
            raise ConfigError("touch_force", self.touch_force, f"at most force_limit, {self.force_limit:g} N")
