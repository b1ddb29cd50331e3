"""Policies in files that are never executed, run with NumPy alone: shipped ones, and policies of run folders.

The shipped ones are in this folder, too: one NAME.safetensors each.

Modules:
    errors: the error of policies.
    layers: fully connected layers.
    cells: recurrent layers, of a GRU or an LSTM.
    base: the base class of the networks of policies.
    network: the forward pass of a policy without memory.
    gain: the forward pass of a policy whose actions vanish with the tip error.
    stacked: the forward pass of a policy that sees the newest observations at once.
    recurrent: the forward pass of a policy with memory.
    file: the container of a policy.
    content: the network in a policy file.
    recorded_score: the score in a policy file: a regression band of fixed episodes.
    shipped: a shipped policy.
    conversion: a trained torch model as a network.
    parameters: policies that have no form in NumPy, in torch, without pickles.
    pickled: policies in the pickles of Stable-Baselines3.
    trained: the policy of a run as a controller.
    export: the policy of a run folder as a shipped policy.
    contract: inputs and outputs of a policy, for programs without this package.
    onnx_file: a policy as an ONNX file.
    loading: shipped policies by name or from a file.
"""
