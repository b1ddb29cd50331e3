"""The design task: change the contact surfaces of a chain until it bends as wanted. It needs torch.

Modules:
    codesign: the task of designing and then controlling.
    codesign_episodes: its episode buffer and drawing.
    config: its settings.
    env: its scalar environment, with the decision process in its docstring.
    episodes: its episode buffer.
    observation: entries of its observation, and their values.
    options: options of reset.
    render: its drawing.
    sampling: its random episodes.
    task: the task: values of designs.
    vector: its native vector environment.
"""
