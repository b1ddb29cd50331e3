"""A small vector environment that keeps the contract, and one subclass for each way of breaking it.

Long on purpose: it is one list, and a fault is best read beside the method that it spoils.
"""

import warnings

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

LIMIT = 5
NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode


class ToyVectorEnv(VectorEnv):
    """Points on a line: pushed by actions and noise, ended beyond 1.2 or after five steps."""

    metadata = {"render_modes": ["rgb_array"], "autoreset_mode": NEXT_STEP}  # noqa: RUF012 (Gymnasium's own form)

    def __init__(self, autoreset_mode=NEXT_STEP, num_envs=3, render_mode=None):
        self.num_envs, self.mode, self.render_mode = num_envs, autoreset_mode, render_mode
        self.metadata = self.metadata | {"autoreset_mode": autoreset_mode}
        self.single_action_space = Box(-1, 1, (1,), np.float32)
        self.single_observation_space = Box(-10, 10, (2,), np.float32)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.generators = [np.random.default_rng() for _ in range(num_envs)]
        self.position, self.steps = np.zeros(num_envs), np.zeros(num_envs, int)
        self.over = np.zeros(num_envs, bool)
        self.everywhere = np.ones(num_envs, bool)

    def reset(self, *, seed=None, options=None):
        mask = (options or {}).get("reset_mask", self.everywhere)
        for lane, lane_seed in enumerate(self.lane_seeds(seed)):
            if mask[lane] and lane_seed is not None:
                self.generators[lane] = np.random.default_rng(lane_seed)
        self.begin(mask)
        return self.observe(), self.infos(mask)

    def step(self, actions):
        fresh = self.over & (self.mode is NEXT_STEP)
        assert self.mode is not DISABLED or not self.over.any()
        self.move(actions[:, 0], ~fresh)
        self.steps = self.steps + 1
        self.begin_again(fresh)
        terminated, truncated = self.ends(fresh)
        rewards = self.rewards(fresh)
        self.over = terminated | truncated
        observations, infos = self.observe(), self.infos(self.everywhere)
        if self.mode is SAME_STEP and self.over.any():
            observations, infos = self.restart(observations, infos, self.over)
        return observations, rewards, terminated, truncated, infos

    def render(self):
        return tuple(np.zeros((4, 6, 3), np.uint8) for _ in range(self.num_envs))

    def lane_seeds(self, seed):
        if seed is None:
            return [None] * self.num_envs
        return [seed + lane for lane in range(self.num_envs)] if isinstance(seed, int) else seed

    def draw(self, mask):
        return np.array(
            [rng.uniform(-0.5, 0.5) if chosen else 0 for rng, chosen in zip(self.generators, mask, strict=True)]
        )

    def begin(self, mask):
        self.position = np.where(mask, self.draw(mask), self.position)
        self.steps = np.where(mask, 0, self.steps)
        self.over = self.over & ~mask

    def begin_again(self, mask):
        self.begin(mask)

    def move(self, push, mask):
        self.position = self.position + np.where(mask, 0.4 * push, 0) + self.draw(mask)

    def ends(self, fresh):
        return (np.abs(self.position) > 1.2) & ~fresh, (self.steps >= LIMIT) & ~fresh

    def rewards(self, fresh):
        return np.where(fresh, 0.0, -np.abs(self.position))

    def observe(self):
        return np.stack([self.position, self.steps], axis=1).astype(np.float32)

    def infos(self, mask):
        detail = {"steps": np.where(mask, self.steps, 0), "_steps": mask.copy()}
        position = np.where(mask, self.position, 0)
        return {"position": position, "_position": mask.copy(), "detail": detail, "_detail": mask.copy()}

    def restart(self, observations, infos, ended):
        final = np.full(self.num_envs, None, object)
        for lane in np.flatnonzero(ended):
            final[lane] = observations[lane].copy()
        last = self.infos(ended)
        self.begin_again(ended)
        handed = {"final_obs": final, "_final_obs": ended.copy(), "final_info": last, "_final_info": ended.copy()}
        return self.observe(), self.infos(self.everywhere) | handed


class ToyEnv(gymnasium.Env):
    """One lane of ToyVectorEnv as a scalar environment."""

    def __init__(self):
        self.batch = ToyVectorEnv(DISABLED, 1)
        self.observation_space = self.batch.single_observation_space
        self.action_space = self.batch.single_action_space

    def reset(self, *, seed=None, options=None):
        observations, infos = self.batch.reset(seed=seed)
        return observations[0], self.info(infos)

    def step(self, action):
        observations, rewards, terminated, truncated, infos = self.batch.step(np.array([action]))
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), self.info(infos)

    def info(self, infos):
        return {"position": float(infos["position"][0]), "detail": {"steps": int(infos["detail"]["steps"][0])}}


BROKEN = []  # (class, checks that it fails, the one mode in which it is checked, or None)


def fails(*checks, mode=None):
    def register(cls):
        BROKEN.append((cls, set(checks), mode))
        return cls

    return register


@fails("runs")
class ResetWithoutInfos(ToyVectorEnv):
    def reset(self, **arguments):
        return super().reset(**arguments)[0]


@fails("runs")
class StepRaises(ToyVectorEnv):
    def step(self, actions):
        raise ValueError("no such step")


@fails("states_num_envs", "batches_the_single_spaces", "leaves_random_numbers_of_lanes_seeded_none")
class CountsLanesInFloats(ToyVectorEnv):
    class Count(float):
        def __index__(self):
            return int(self)

    def __init__(self, autoreset_mode=NEXT_STEP):
        super().__init__(autoreset_mode)
        self.num_envs = self.Count(3)


@fails("batches_the_single_spaces")
class OtherSingleSpace(ToyVectorEnv):
    def __init__(self, autoreset_mode=NEXT_STEP):
        super().__init__(autoreset_mode)
        self.single_observation_space = Box(-9, 9, (2,), np.float32)


@fails("states_its_autoreset_mode", mode=NEXT_STEP)
class ModeInWords(ToyVectorEnv):
    def __init__(self, autoreset_mode=NEXT_STEP):
        super().__init__(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": autoreset_mode.value}


@fails(
    "states_its_autoreset_mode",
    "truncates_at_its_time_limit",
    "restarts_with_a_reset_observation",
    "hands_over_final_obs_and_final_info",
    "hands_over_the_last_observation_and_info",
)
class AlwaysNextStep(ToyVectorEnv):
    def __init__(self, autoreset_mode=NEXT_STEP):
        super().__init__(NEXT_STEP)


@fails("returns_observations_of_its_space", "hands_over_final_obs_and_final_info")
class ObservationsInDoublePrecision(ToyVectorEnv):
    def observe(self):
        return super().observe().astype(float)


@fails("returns_observations_of_its_space", "hands_over_final_obs_and_final_info")
class ObservationsOutOfBounds(ToyVectorEnv):
    def observe(self):
        return super().observe() + np.float32(8)


@fails("returns_one_float_reward_per_lane")
class WholeRewards(ToyVectorEnv):
    def rewards(self, fresh):
        return super().rewards(fresh).astype(int)


@fails("returns_one_float_reward_per_lane")
class InfiniteRewards(ToyVectorEnv):
    def rewards(self, fresh):
        return np.where(self.steps == 2, np.inf, super().rewards(fresh))


@fails("returns_one_bool_per_lane_for_each_end")
class EndsInNumbers(ToyVectorEnv):
    def step(self, actions):
        observations, rewards, terminated, truncated, infos = super().step(actions)
        return observations, rewards, terminated.astype(int), truncated, infos


@fails("returns_infos_as_arrays_with_masks")
class NestedInfoWithoutMask(ToyVectorEnv):
    def infos(self, mask):
        infos = super().infos(mask)
        del infos["detail"]["_steps"]
        return infos


@fails("returns_infos_as_arrays_with_masks", mode=NEXT_STEP)
class InfoForTheBatch(ToyVectorEnv):
    def infos(self, mask):
        return super().infos(mask) | {"gravity": 9.81, "_gravity": mask.copy()}


@fails("returns_infos_as_arrays_with_masks", mode=NEXT_STEP)
class MaskInNumbers(ToyVectorEnv):
    def infos(self, mask):
        return super().infos(mask) | {"_position": mask.astype(int)}


@fails("renders_one_frame_per_lane")
class FramesInAList(ToyVectorEnv):
    def __init__(self, autoreset_mode=NEXT_STEP):
        super().__init__(autoreset_mode, render_mode="rgb_array")

    def render(self):
        return list(super().render())


@fails("renders_one_frame_per_lane")
class FramesInFloats(FramesInAList):
    def render(self):
        return tuple(frame / 255 for frame in ToyVectorEnv.render(self))


@fails("closes_twice")
class StaysOpen(ToyVectorEnv):
    def close(self):
        pass


@fails("closes_twice")
class ClosesOnce(ToyVectorEnv):
    def close(self):
        assert not self.closed
        self.closed = True


@fails("repeats_the_rollout_of_a_seed", "counts_an_integer_seed_up_over_lanes")
class CarriesNoiseAcrossResets(ToyVectorEnv):
    carried = 0.0

    def move(self, push, mask):
        super().move(push + 0.1 * self.carried, mask)
        self.carried = self.position.sum()


@fails("repeats_the_rollout_in_a_new_environment")
class EveryInstanceDiffers(ToyVectorEnv):
    built = 0

    def __init__(self, autoreset_mode=NEXT_STEP):
        super().__init__(autoreset_mode)
        EveryInstanceDiffers.built += 1
        self.bias = 0.001 * self.built

    def move(self, push, mask):
        super().move(push + self.bias, mask)


@fails("counts_an_integer_seed_up_over_lanes", "takes_one_seed_per_lane")
class CountsSeedsInTwos(ToyVectorEnv):
    def lane_seeds(self, seed):
        return [seed + 2 * lane for lane in range(3)] if isinstance(seed, int) else super().lane_seeds(seed)


@fails("takes_one_seed_per_lane", "leaves_random_numbers_of_lanes_seeded_none")
class UsesTheFirstSeedOnly(ToyVectorEnv):
    def lane_seeds(self, seed):
        return super().lane_seeds(seed[0] if isinstance(seed, list) else seed)


@fails("leaves_random_numbers_of_lanes_seeded_none")
class SeedsNoneWithZero(ToyVectorEnv):
    def lane_seeds(self, seed):
        return [lane_seed or 0 for lane_seed in seed] if isinstance(seed, list) else super().lane_seeds(seed)


@fails(
    "gives_lanes_different_random_numbers",
    "counts_an_integer_seed_up_over_lanes",
    "takes_one_seed_per_lane",
)
class OneSeedForAllLanes(ToyVectorEnv):
    def lane_seeds(self, seed):
        return [seed] * 3 if isinstance(seed, int) else super().lane_seeds(seed)


@fails(
    "goes_on_with_its_random_numbers_without_a_seed",
    "leaves_random_numbers_of_lanes_seeded_none",
    "restarts_with_a_reset_observation",
)
class ResetRepeatsTheSeed(ToyVectorEnv):
    last = None

    def lane_seeds(self, seed):
        self.last = super().lane_seeds(self.last if seed is None else seed)
        return self.last


@fails(
    "goes_on_with_its_random_numbers_without_a_seed",
    "leaves_random_numbers_of_lanes_seeded_none",
    "restarts_with_a_reset_observation",
    mode=NEXT_STEP,
)
class ResetDrawsFromElsewhere(ToyVectorEnv):
    def reset(self, *, seed=None, options=None):
        if seed is None:
            self.generators = [np.random.default_rng() for _ in range(3)]
        return super().reset(seed=seed, options=options)


@fails("keeps_what_it_returned", "returns_new_memory_in_every_call")
class ReusesItsObservations(ToyVectorEnv):
    def observe(self):
        if not hasattr(self, "buffer"):
            self.buffer = np.empty((3, 2), np.float32)
        self.buffer[:] = super().observe()
        return self.buffer


@fails("returns_new_memory_in_every_call", "does_not_use_what_it_returned_or_was_given")
class ReturnsAConstantAgain(ToyVectorEnv):
    def __init__(self, autoreset_mode=NEXT_STEP):
        super().__init__(autoreset_mode)
        self.limits = np.full(3, LIMIT)

    def infos(self, mask):
        return super().infos(mask) | {"limit": self.limits, "_limit": mask.copy()}


@fails("does_not_use_what_it_returned_or_was_given")
class ReturnsItsState(ToyVectorEnv):
    def infos(self, mask):
        return super().infos(mask) | {"position": self.position, "_position": mask.copy()}


@fails("does_not_use_what_it_returned_or_was_given")
class KeepsTheActions(ToyVectorEnv):
    previous = np.float32(0)

    def begin(self, mask):
        super().begin(mask)
        if mask.any():
            self.previous = np.where(mask, 0, self.previous)

    def move(self, push, mask):
        super().move(push + 0.1 * self.previous, mask)
        self.previous = push


@fails("leaves_its_arguments_alone")
class ScalesActionsInPlace(ToyVectorEnv):
    def step(self, actions):
        actions *= 0.5
        return super().step(actions)


@fails("leaves_its_arguments_alone")
class TakesTheMaskOut(ToyVectorEnv):
    def reset(self, *, seed=None, options=None):
        mask = (options or {}).pop("reset_mask", self.everywhere)
        return super().reset(seed=seed, options={"reset_mask": mask})


@fails("truncates_at_its_time_limit")
class TruncatesLate(ToyVectorEnv):
    def ends(self, fresh):
        return super().ends(fresh)[0], (self.steps > LIMIT) & ~fresh


@fails("truncates_at_its_time_limit", mode=SAME_STEP)
class CountsStepsOnAfterAnEnd(ToyVectorEnv):
    def ends(self, fresh):
        self.taken = self.taken + 1
        return super().ends(fresh)[0], (self.taken % LIMIT == 0) & ~fresh

    def reset(self, **arguments):
        self.taken = 0
        return super().reset(**arguments)


@fails("equals_scalar_environments", "agrees_with_other_modes_until_an_episode_ends")
class OtherRewardsInOneMode(ToyVectorEnv):
    def rewards(self, fresh):
        return super().rewards(fresh) * (2 if self.mode is SAME_STEP else 1)


@fails("equals_scalar_environments")
class DoubleRewards(ToyVectorEnv):
    def rewards(self, fresh):
        return 2 * super().rewards(fresh)


@fails("equals_scalar_infos")
class MoreInfos(ToyVectorEnv):
    def infos(self, mask):
        return super().infos(mask) | {"distance": np.abs(self.position), "_distance": mask.copy()}


@fails("restarts_with_a_reset_observation")
class RestartsInTheMiddle(ToyVectorEnv):
    def begin_again(self, mask):
        super().begin_again(mask)
        self.position = np.where(mask, 0, self.position)


@fails("restarts_with_a_reset_observation")
class RestartsAfterItsObservation(ToyVectorEnv):
    def restart(self, observations, infos, ended):
        return observations, super().restart(observations, infos, ended)[1]


@fails("gives_no_reward_and_no_end_in_the_restarting_step")
class RewardsTheRestart(ToyVectorEnv):
    def rewards(self, fresh):
        return super().rewards(fresh & False)


@fails("gives_no_reward_and_no_end_in_the_restarting_step")
class EndsTheRestart(ToyVectorEnv):
    def ends(self, fresh):
        terminated, truncated = super().ends(fresh)
        return terminated | (fresh & (self.position > 0)), truncated


@fails("ignores_actions_in_the_restarting_step")
class RemembersTheActionOfTheRestart(ToyVectorEnv):
    remembered = 0.0

    def reset(self, **arguments):
        self.remembered = 0.0
        return super().reset(**arguments)

    def move(self, push, mask):
        super().move(push + self.remembered, mask)
        self.remembered = np.where(mask, 0, push)


class OtherFinal(ToyVectorEnv):
    """Same-step autoreset whose final_obs and final_info are changed by `other`."""

    def restart(self, observations, infos, ended):
        observations, infos = super().restart(observations, infos, ended)
        return observations, infos | self.other(observations, infos, ended)


@fails("hands_over_final_obs_and_final_info")
class FinalMaskEverywhere(OtherFinal):
    def other(self, observations, infos, ended):
        return {"_final_obs": self.everywhere.copy()}


@fails("hands_over_final_obs_and_final_info")
class FinalObservationsEverywhere(OtherFinal):
    def other(self, observations, infos, ended):
        final = infos["final_obs"]
        for lane in np.flatnonzero(~ended):
            final[lane] = observations[lane].copy()
        return {"final_obs": final}


@fails("hands_over_final_obs_and_final_info")
class FinalObservationsInOneArray(OtherFinal):
    def other(self, observations, infos, ended):
        final = [row if row is not None else np.zeros(2, np.float32) for row in infos["final_obs"]]
        return {"final_obs": np.array(final)}


@fails("hands_over_the_last_observation_and_info")
class FinalObservationAfterTheRestart(OtherFinal):
    def other(self, observations, infos, ended):
        final = infos["final_obs"]
        for lane in np.flatnonzero(ended):
            final[lane] = observations[lane].copy()
        return {"final_obs": final}


@fails("hands_over_the_last_observation_and_info")
class FinalInfoAfterTheRestart(OtherFinal):
    def other(self, observations, infos, ended):
        return {"final_info": infos["final_info"] | {"position": infos["position"].copy()}}


@fails("masked_resets_leave_other_lanes_alone", "truncates_at_its_time_limit", mode=DISABLED)
class ResetsEveryLane(ToyVectorEnv):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)


@fails("masked_resets_leave_other_lanes_alone", mode=DISABLED)
class MaskedResetDrawsForEveryLane(ToyVectorEnv):
    def reset(self, *, seed=None, options=None):
        observations, infos = super().reset(seed=seed, options=options)
        if options:
            self.draw(~options["reset_mask"])
        return observations, infos


@fails("masked_resets_begin_their_lanes_anew", "masked_resets_seed_their_lanes", "restarts_with_a_reset_observation")
class MaskedResetOnlyClearsTheEnd(ToyVectorEnv):
    def reset(self, *, seed=None, options=None):
        if not options:
            return super().reset(seed=seed)
        self.over, self.steps = self.over & False, np.where(options["reset_mask"], 0, self.steps)
        return self.observe(), self.infos(options["reset_mask"])


@fails("masked_resets_seed_their_lanes")
class MaskedResetForgetsTheSeed(ToyVectorEnv):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=None if options else seed, options=options)


@fails("warns_of_nothing")
class Warns(ToyVectorEnv):
    def step(self, actions):
        warnings.warn("the line is slippery", stacklevel=1)
        return super().step(actions)
