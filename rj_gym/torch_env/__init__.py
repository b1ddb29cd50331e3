"""The planar tracking tasks as vector environments of torch tensors on a device, equal to the native ones.

No other module of rj_gym imports this package; `import rj_gym` needs no torch. docs/gpu.md shows it.

Modules:
    actuation: motors between actions and tendons, in torch.
    env: the vector environment.
    host: the host's side: episodes begin there, and lanes that the device leaves are solved there.
    infos: infos as tensors, in Gymnasium's vector form.
    lanes: running episodes as tensors.
    observing: observations as tensors.
    refusals: settings and devices that cannot be used.
    sensing: measurements, past readings and the privileged state, in torch.
    stepping: the formulas of a step, in torch.
"""

from rollingjoint.errors import naming_extras

with naming_extras():
    from rj_gym.torch_env.env import TorchTrackingEnv

__all__ = ["TorchTrackingEnv"]
