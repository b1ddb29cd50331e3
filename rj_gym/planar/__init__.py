"""The planar tracking task: bring the tip of a rolling-contact chain to a target under an unknown force.

Modules:
    config: its settings.
    env: its scalar environments, with the decision process in their docstrings.
    episodes: its episode buffer.
    kernels: its formulas, compiled.
    measuring: what is measured, and the privileged state, compiled.
    observation: entries of its observation.
    options: options of reset.
    render: its drawing.
    sampling: its random episodes.
    task: the task.
    vector: its native vector environments.
    worlds: settings of worlds in which the tip is not seen, or late.
"""
