"""Tracking with many mechanisms: every episode draws a mechanism from a design space, lanes have different ones.

Lanes with as many links are stepped together by the episode buffer of the tracking tasks; this room draws mechanisms,
distributes lanes, and pads their observations. It needs torch, by which design spaces compute, and is imported when one
of its environments is first asked for.

Modules:
    config: settings.
    designs: designs by number, and their description in observations.
    env: the scalar environments, with the decision process in their docstrings.
    episodes: running episodes, distributed by number of links.
    kernels: observations of all lanes, compiled, from those by number of links.
    task: the task: of all mechanisms together, and of those with as many links.
    vector: the native vector environments.
"""
