"""Evaluation: controllers in the same episodes, their scores, and the smallest errors that are possible.

Modules:
    rollout: episodes of an environment under a controller.
    blocks: episodes of several controllers, wherever an executor runs them.
    score: the score of one controller.
    floor: the smallest tip error that any command can reach.
    report: scores of several controllers, as table, Markdown and plain values.
    pictures: error over time, distribution of errors, animation.
    output: the files of an evaluation.
    recording: episodes with all that happened in them.
    minari_dataset: such episodes as a Minari dataset.
"""

import sys

from agents.controllers import controller, policy

sys.modules |= {f"{__name__}.controller": controller, f"{__name__}.policy": policy}  # where they were until 0.1.0
