"""Measurements in torch, for all lanes: the formulas of rj_gym/tracking/measuring.py."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from rj_gym.core.columns import FORCE, LINK, STEP, TARGET, TIP
from rj_gym.torch_env.lanes import Lanes, at_step, tendons
from rj_gym.tracking.arrays import GAIN, LIMIT, MOTOR, OFFSET, TAKEN, Rules
from rollingjoint.differentiable.formulas import sheath_direction, sheath_ratio


@dataclass(frozen=True)
class Sensors:
    """Sensors at the end of every step, on a device: none where motors and sensors are not active."""

    rules: Rules
    stiffnesses: Tensor  # of the nominal tendons, (m,) N/mm
    privileged_low: Tensor  # (K,)
    privileged_high: Tensor  # (K,)

    @classmethod
    def of(cls, rules: Rules, device: torch.device) -> Sensors:
        """The sensors of these rules."""
        hardware = rules.hardware
        arrays = hardware.stiffnesses, hardware.privileged_low, hardware.privileged_high
        return cls(rules, *(torch.tensor(array, dtype=torch.float64, device=device) for array in arrays))

    def measured(self, lanes: Lanes) -> Lanes:
        """The lanes after a step with its measurements; the privileged state goes into their readings."""
        hardware = self.rules.hardware
        if not hardware.active:
            return lanes
        lanes = replace(lanes, measured=self._tendons(lanes))
        if hardware.late:
            lanes = self._pictured(lanes)
        lanes = replace(lanes, past=self._remembered(lanes))
        if len(self.privileged_low):
            truth = torch.clamp(self._truth(lanes), self.privileged_low, self.privileged_high)
            first = hardware.privileged_at
            lanes.readings[:, first : first + truth.shape[1]] = truth
        return lanes

    def _tendons(self, lanes: Lanes) -> Tensor:
        """Measured motor positions [mm] and tensions [N], rows SENSED, (B, 2, m)."""
        hardware, steps = self.rules.hardware, lanes.readings[:, STEP]
        tensions, commands = tendons(lanes)
        positions = lanes.motors[:, MOTOR]
        if not hardware.cells_at_tendons:
            tensions = tensions * sheath_ratio(lanes.sheath, sheath_direction(commands, positions, lanes.half_play))
        if len(lanes.cells):
            tensions = (lanes.cells[:, GAIN] * tensions + lanes.cells[:, OFFSET]).clamp(min=0.0)
        if lanes.encoder_noise.shape[1]:
            positions = positions + at_step(lanes.encoder_noise, steps)
        if lanes.tension_noise.shape[1]:
            tensions = (tensions + at_step(lanes.tension_noise, steps)).clamp(min=0.0)
        rounded = _rounded(positions, hardware.encoder_resolution), _rounded(tensions, hardware.tension_resolution)
        return torch.stack(rounded, 1)

    def _pictured(self, lanes: Lanes) -> Lanes:
        """The lanes with the true pose kept for pictures that come later, and the picture that is seen now."""
        hardware, steps, before = self.rules.hardware, lanes.readings[:, STEP].long(), lanes.picture[:, TAKEN]
        age = steps.clamp(max=hardware.picture_delay)
        taken = torch.where((steps + lanes.phase) % hardware.period == 0, steps - age, before)
        new = taken > before
        poses = torch.cat([lanes.poses[:, 1:].flatten(1)[:, None], lanes.pictures[:, :-2]], 1)
        shown = torch.where(new[:, None], at_step(poses, age), lanes.pictures[:, -1])
        pictures = torch.cat([poses, shown[:, None]], 1)
        return replace(lanes, pictures=pictures, picture=torch.stack([taken, new.long()], 1))

    def _remembered(self, lanes: Lanes) -> Tensor:
        """Actions, measured positions and tensions, and tip errors, the newest step first, (B, times, width)."""
        past, actions = lanes.past, lanes.actions[:, 0]
        parts = [torch.zeros_like(actions), lanes.measured.flatten(1)]
        if self.rules.first_seen < lanes.poses.shape[1] - 1:
            parts.append(lanes.readings[:, TARGET : TARGET + 2] - seen_poses(self.rules, lanes)[:, -1, :2])
        before = torch.cat([actions, past[:, 0, actions.shape[-1] :]], -1)
        return torch.cat([torch.cat(parts, -1)[:, None], before[:, None], past[:, 1:-1]], 1)[:, : past.shape[1]]

    def _truth(self, lanes: Lanes) -> Tensor:
        """The privileged state, not yet within its bounds, (B, K)."""
        rules, readings, moving = self.rules, lanes.readings, lanes.poses.shape[1] - 1
        tensions, commands = tendons(lanes)
        offset = readings[:, TARGET : TARGET + 2] - readings[:, TIP : TIP + 2]
        parts = [link_entries(rules, lanes.poses[:, 1:]), offset / rules.error_scale]
        parts += load_entries(rules, readings, moving)
        parts += [commands - lanes.motors[:, MOTOR], lanes.half_play, lanes.sheath, tensions / rules.highest_tension]
        parts += [lanes.actuator_offsets, lanes.stiffnesses / self.stiffnesses]
        parts += [lanes.limits[:, LIMIT]] if len(lanes.limits) else []
        parts += [readings[:, STEP, None] / rules.hardware.steps, lanes.tip_rates.flatten(1)]
        return torch.cat(parts, -1)


def seen_poses(rules: Rules, lanes: Lanes) -> Tensor:
    """Measured poses of the moving links, (B, n - 1, 3) [mm, mm, rad]."""
    poses, steps = lanes.poses[:, 1:], lanes.readings[:, STEP]
    if rules.hardware.late:
        poses, steps = lanes.pictures[:, -1].view(poses.shape), lanes.picture[:, TAKEN]
    return poses + at_step(lanes.noise, steps) if lanes.noise.shape[1] else poses


def link_entries(rules: Rules, poses: Tensor) -> Tensor:
    """Observed entries of poses (B, links, 3): x, y, cosine and sine of every link, (B, 4 links)."""
    angles = poses[..., 2]
    return torch.stack([*(poses[..., :2] / rules.length).unbind(-1), angles.cos(), angles.sin()], -1).flatten(1)


def load_entries(rules: Rules, readings: Tensor, moving: int) -> list[Tensor]:
    """Observed entries of the load: its force, (B, 2), and 1 for the link that it pulls, (B, moving)."""
    links = torch.arange(1, moving + 1, device=readings.device)
    return [readings[:, FORCE : FORCE + 2] / rules.force_scale, (readings[:, LINK, None] == links).double()]


def _rounded(values: Tensor, resolution: float) -> Tensor:
    return values if resolution <= 0.0 else resolution * (values / resolution + 0.5).floor()
