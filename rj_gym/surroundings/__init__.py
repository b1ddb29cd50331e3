"""Tasks among walls: the tip along a bent lumen, past obstacles, to a wall that is not known.

Modules:
    config: their settings, and families of lumens.
    drawing: random surroundings and targets.
    env: the scalar environments, with the decision processes in their docstrings.
    episodes: their episode buffer.
    observation: entries of observations, and their values.
    options: options of reset.
    render: their drawing.
    scenes: what surrounds an instrument in an episode, in arrays of many.
    task: the tasks: a step among walls, its reward and its success.
    vector: the native vector environments.
"""
