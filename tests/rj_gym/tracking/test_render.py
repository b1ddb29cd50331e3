"""Pictures: one drawing for window and array, without a screen."""

from dataclasses import replace
from functools import partial

import gymnasium
import numpy as np
import pygame
import pytest

from rj_gym import RollingJointEnv
from rj_gym.rendering import SIZE, tension_color
from rj_gym.tracking.render import ArmCanvas
from rollingjoint.errors import InvalidInput


def frame(env, seed=0, steps=5, options=None):
    env.reset(seed=seed, options=options)
    for _ in range(steps):
        env.step(np.array([0.5, -0.5] * (env.action_space.shape[0] // 2)))
    return env.render()


@pytest.mark.parametrize("mechanism", ["five_link", "two_segment"])
def test_a_picture_has_the_stated_size_and_shows_something(mechanism):
    picture = frame(RollingJointEnv(render_mode="rgb_array", mechanism=mechanism, target={"process": "path"}))
    assert picture.shape == (SIZE[1], SIZE[0], 3) and picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    background = np.all(picture == picture[-1, -1], axis=-1).mean()
    assert 0.5 < background < 0.95


def test_the_same_state_gives_the_same_picture_and_another_state_another():
    env = RollingJointEnv(render_mode="rgb_array")
    first = frame(env)
    assert np.array_equal(first, env.render())
    assert np.array_equal(first, frame(RollingJointEnv(render_mode="rgb_array")))
    assert not np.array_equal(first, frame(env, steps=6))


def test_a_picture_without_load_has_no_arrow():
    def orange(picture):
        red, green, blue = picture[120:].astype(int).transpose(2, 0, 1)  # below the captions
        return np.count_nonzero((red > 200) & (abs(green - 108) < 25) & (blue < 60))

    env = RollingJointEnv(render_mode="rgb_array")
    assert orange(frame(env, options={"load": {"link": 3, "force": (1.0, 0.0)}})) > 100
    assert orange(frame(env, options={"load": {"link": 3, "force": (0.0, 0.0)}})) == 0


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
def test_the_arrow_of_gravity_stays_below_the_words(gravity):
    envs = gymnasium.make_vec("rj_gym/PitchYaw-v0", 1, "vector_entry_point")
    envs.reset(seed=0)
    scene = replace(envs.unwrapped.scene(), gravity=np.array(gravity), payload=np.zeros(3))
    pictures = []
    for forces in (ArmCanvas._forces, lambda canvas, scene: None):
        canvas = ArmCanvas(scene.mechanism)
        canvas._forces = partial(forces, canvas)
        pictures.append(pygame.surfarray.array3d(canvas.draw(scene)).astype(int))
    rows = np.flatnonzero(np.abs(pictures[0] - pictures[1]).max(axis=(0, 2)) > 20)
    assert 150 < rows.min() < rows.max() < 300  # the words end at 146


def test_pictures_are_fresh_arrays():
    env = RollingJointEnv(render_mode="rgb_array")
    first = frame(env)
    second = env.render()
    first[:] = 0
    assert second.any()


def test_the_window_works_without_a_screen_and_closes_twice():
    env = gymnasium.make("rj_gym/RollingJoint-v0", render_mode="human", disable_env_checker=True)
    env.unwrapped.metadata = env.metadata | {"render_fps": 0}  # no waiting in a test
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert env.render() is None
    env.close()
    env.close()


def test_an_unknown_render_mode_is_refused():
    with pytest.raises(InvalidInput, match="rgb_array"):
        RollingJointEnv(render_mode="ascii")


def test_tension_colours_run_from_blue_to_red():
    low, high = tension_color(0.5, (0.5, 15.0)), tension_color(15.0, (0.5, 15.0))
    assert low[2] > low[0] and high[0] > high[2]
    assert tension_color(-5.0, (0.5, 15.0)) == low and tension_color(99.0, (0.5, 15.0)) == high
