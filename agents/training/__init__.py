"""Training: from a configuration to a run folder with a policy.

Modules:
    asymmetric: networks with a critic that sees more than the policy.
    gain: policies of Stable-Baselines3 with actions that vanish with the tip error.
    convolution: a temporal convolution over past readings, before the hidden layers.
    residual: environments with the outputs of a controller.
    build: environments and model of a configuration.
    start: the model with which a run begins, fresh or as an earlier policy.
    learn: a run from its beginning, or continued.
    callbacks: checkpoints, evaluations, progress, stopping on a signal.
    checkpoint: checkpoints, from which a run continues exactly.
    state: a model's state in plain values and arrays.
    old_checkpoint: checkpoints of earlier versions, in pickles.
    tracking: a tracker beside the run folder.
    log: the training log, which a resumed run continues.
    campaign: many runs, some at a time.

This package imports no modules: torch and Stable-Baselines3 are loaded by the modules that need them.
"""
