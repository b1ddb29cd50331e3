"""Co-design of a mechanism and its policy: rj codesign lumen --out runs/codesign/lumen.

Modules:
    config: the checked content of a co-design file.
    task: the protocol of a task: episodes, scores, gradients.
    policy: policies whose parameters are one vector.
    rollout: rollouts in compiled code, with gradients by policy and design.
    lumen: the task in the lumen.
    hold: tasks at the tip.
    pair: a design and a policy, trained by one gradient.
    generalist: a policy that knows the design.
    rivals: the best designs of mechanical objectives, and random ones.
    study: the units of a co-design, and its folder.
    report: its report.
    pictures: its pictures, and its film.

No module is imported here: torch is loaded by the modules that need it.
"""
