"""The arm's tracking task: bring the tip of a hanging arm to a target under unknown gravity and payload.

Modules:
    config: its settings.
    env: its scalar environments, with the decision process in their docstrings.
    episodes: its episode buffer.
    kernels: its formulas, compiled.
    observation: entries of its observation.
    options: options of reset.
    render: its drawing.
    sampling: its random episodes.
    task: the task.
    vector: its native vector environments.
"""
