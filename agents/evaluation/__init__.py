"""Evaluation: controllers in the same episodes, their scores, and the smallest errors that are possible.

Modules:
    controller: the Controller protocol, and what a controller sees.
    rollout: episodes of an environment under a controller.
    score: the score of one controller.
    floor: the smallest tip error that any command can reach.
    report: scores of several controllers, as table, Markdown and plain values.
    pictures: error over time, distribution of errors, animation.
    output: the files of an evaluation.
    policy: the policy of a run folder as a controller.
"""
