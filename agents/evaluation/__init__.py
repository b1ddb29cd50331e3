"""Evaluation: controllers in the same episodes, their scores, and the smallest errors that are possible.

Modules:
    controller: the Controller protocol, and what a controller sees.
    rollout: episodes of an environment under a controller.
    blocks: episodes of several controllers, wherever an executor runs them.
    score: the score of one controller.
    floor: the smallest tip error that any command can reach.
    report: scores of several controllers, as table, Markdown and plain values.
    pictures: error over time, distribution of errors, animation.
    output: the files of an evaluation.
    policy: a model of Stable-Baselines3 as a controller.
    recording: episodes with all that happened in them.
    minari_dataset: such episodes as a Minari dataset.
"""
