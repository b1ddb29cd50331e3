"""The scalar design environment: a Gymnasium shell around a single lane."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.info import every_lane
from rj_gym.design.config import DesignConfig
from rj_gym.design.episodes import Lanes, sampled_info
from rj_gym.design.observation import observation_space
from rj_gym.design.options import checked_options
from rj_gym.design.render import DesignRenderer, scene
from rj_gym.design.task import design_task
from rollingjoint.errors import InvalidInput

_ALONE = np.zeros(1, np.int64)


class CurvatureDesignEnv(gymnasium.Env[Any, NDArray[np.float32]]):
    """Change the contact surfaces of a chain, step by step, until it bends into given shapes: inverse design.

    A design is a vector of d numbers in [-1, 1], a point of a `rollingjoint.design.DesignSpace`: by default the
    curvatures at five knots of the child and of the parent surface that all joints share, d = 10. It is judged in K
    cases (3), each a pair of tendon tensions and a force on the tip. The targets are the shapes of a hidden design in
    these cases, so that an error of 0 is possible. n links, of which n - 1 move; q = 5 margins; length L = n times the
    middle link height (100 mm).

    ## Action space
    `Box(-1, 1, (d,), float32)`: change of the design vector in units of `action_scale` (0.25). Values beyond [-1, 1]
    are clipped, and so is the design at its box.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. `rj_gym.design_observation_entries` lists
    them.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | (names of the design space) | the design vector | half range | -1 | 1 |
    | rolling margin, clearance margin, radius margin, holes margin, thickness margin | valid: 0 or more | 1 | -1 | 1 |
    | case k error | root mean square distance of the links from their targets, k = 0 ... K - 1 | 10 mm | 0 | 5 |
    | error | the same over all cases | 10 mm | 0 | 5 |
    | case k link i x deviation, case k link i y deviation | target minus origin of moving link i | 10 mm | -5 | 5 |
    | case k link i x target, case k link i y target | where its origin should be | L | -2 | 2 |
    | case k force x, case k force y | force on the tip | largest `force` (0.3 N) | -1 | 1 |
    | case k left tension, case k right tension | of the tendons | largest of `tensions` (6 N) | 0 | 1 |

    A design that is not valid has no shape: its deviations are 0 and its errors those of `largest_error_mm` (50 mm).

    ## Reward
    The sum of the terms, each in `info["reward_terms"]`:

    | Term | Value |
    |---|---|
    | improvement | log((error before + `offset_mm`) / (error after + `offset_mm`)), `offset_mm` 0.5; or linear |
    | violation | - `violation` (1) · sum of the margins' shortfalls below 0 |
    | failure | - `failure` (1) where a valid design has no equilibrium in some case, else 0 |

    Improvements add up to that of the whole episode.

    ## Start
    Drawn per episode: the forces, uniform in direction and in magnitude (`force`, 0 to 0.3 N); a hidden design and one
    to begin with, both valid and uniform in the box (`start`: or the space's reference). `reset(options=...)` fixes any
    of "design", "target_design", "forces" and "tensions"; what was drawn is in `info["sampled"]`.

    ## Episode end
    Truncated by the environment itself after `episode_steps` (20); no TimeLimit is registered. Never terminated: a
    design that is not valid, or has no equilibrium, has the largest error and can be left again.

    ## Info
    `error_mm` over all cases, `case_errors_mm` (K,), `valid`, `status` (name of the worst rollingjoint Status of the
    cases), `margins` (q,), `design` (d,), `positions` (K, n - 1, 2) [mm]; from `step` also `reward_terms`, from `reset`
    also `sampled`.

    ## Arguments
    `CurvatureDesignEnv(render_mode=None, config=None, **overrides)`: `config` is a DesignConfig or a dictionary of its
    fields; overrides go on top, and nested ones change only what they name:
    `gymnasium.make("rj_gym/CurvatureDesign-v0", space={"knots": 3}, force=(0, 0.1))`.
    See DesignConfig, DesignRewardConfig and rollingjoint.design.DesignSpace.

    ## Version history
    * v0: first version.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 4}  # noqa: RUF012 (Gymnasium's own form)

    def __init__(
        self,
        render_mode: str | None = None,
        config: DesignConfig | Mapping[str, Any] | None = None,
        **overrides: Any,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidInput("render_mode", render_mode, f"None or one of {self.metadata['render_modes']}")
        self.task = design_task(config, overrides)
        self.render_mode = render_mode
        self.action_space = spaces.Box(-1.0, 1.0, (self.task.space.dimensions,), np.float32)
        self.observation_space: spaces.Space[Any] = observation_space(self.config)
        self._lanes = Lanes(self.task, 1)
        self._begun = False
        self._over = True
        self._renderer: DesignRenderer | None = None

    @property
    def config(self) -> DesignConfig:
        """The settings."""
        return self.task.config

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """First observation and info of a new episode.

        Args:
            seed: of the environment's random numbers.
            options: what to hold fixed; see rj_gym.design.options.checked_options.
        Raises:
            InvalidInput: options that cannot be used; the running episode goes on then.
        """
        fixed = checked_options(options, self.task)
        super().reset(seed=seed)
        episodes = self._lanes.begin(_ALONE, [self.np_random], fixed)
        self._begun, self._over = True, False
        if self.render_mode == "human":
            self.render()
        (info,) = every_lane(self._lanes.state_info() | {"sampled": sampled_info(episodes)}, [0])
        return self._lanes.observe()[0], info

    def step(self, action: ArrayLike) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated and info after one change of the design.

        Raises:
            InvalidInput: an action that is not (d,) finite numbers; nothing has changed then.
            gymnasium.error.ResetNeeded: before the first reset, or after the end of an episode.
        """
        if self._over:
            raise ResetNeeded("No episode is running: call reset() before step().")
        lanes = self._lanes
        lanes.advance(_ALONE, lanes.checked("action", action, (self.task.space.dimensions,))[None])
        self._over = bool(lanes.steps[0] >= self.config.episode_steps)
        if self.render_mode == "human":
            self.render()
        (info,) = every_lane(lanes.state_info() | {"reward_terms": lanes.reward_info()}, [0])
        return lanes.observe()[0], float(lanes.rewards[0]), False, self._over, info

    def render(self) -> NDArray[np.uint8] | None:
        """The picture (H, W, 3) in mode "rgb_array"; in mode "human" it goes to the window."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() needs render_mode "human" or "rgb_array" in gymnasium.make.')
            return None
        if not self._begun:
            raise ResetNeeded("There is nothing to draw yet: call reset() before render().")
        if self._renderer is None:
            self._renderer = DesignRenderer(self.task.length)
        if self.render_mode == "rgb_array":
            return self._renderer.picture(scene(self._lanes))
        self._renderer.show(scene(self._lanes), self.metadata["render_fps"])
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderer": None}
