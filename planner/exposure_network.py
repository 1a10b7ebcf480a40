"""A network that corrects what the map says of the robot's exposure.

The map shows front faces alone, takes a fence for a wall, and knows nothing of what stands behind a tree.
What that usually means for who sees what can be learnt from the true scenes. The network is a small U-Net
(Ronneberger et al. 2015) with CBAM (Woo et al. 2018) at its bottom; it adds to the log-odds of the sensed
exposure, nothing before it has learnt something, for its last layer begins with zeros.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from planner.checkpoint import PolicyError, PolicyName, load_weights, read_tensors, weights, write_tensors
from planner.frames import Percept
from planner.map_sight import occluders
from planner.networks import Attention
from planner.sensed_exposure import STRIDE, views_on_map

CELLS = 64
"""Cells a side of the window about the robot, `STRIDE` cells of its map each."""

CHANNELS = (
    "sensed exposure", "unknown ground", "obstacle", "ground height", "top", "hanging", "light let through",
    "distance", "bearing cosine", "bearing sine", "observer distance", "observers", "eye height",
)  # fmt: skip

LEAST = 0.02
"""Share of light that no log-odds go below, nor above one less it."""

WIDEST = 512
WIDTHS = (16, 32, 48)
ARCHITECTURE = "exposure_unet"


@dataclass(frozen=True)
class Window:
    """The part of a percept's map that the network reads: its layers (channels, 64, 64) float32, world
    aligned, and the rows and columns of the map that its cells are centred on."""

    layers: np.ndarray
    rows: np.ndarray
    cols: np.ndarray


def window(percept: Percept, sensed: np.ndarray) -> Window:
    """The network's layers, about the robot, as `CHANNELS` names them: heights over the robot in 4 m,
    distances from it in 13 m, from the nearest observer, at whom the bearing points, in 50 m.

    sensed : (rows, cols) of `sensed_exposure`
    """
    grid, pose = percept.grid, percept.pose
    row, col = grid.cell(pose.x, pose.y)
    steps = STRIDE * (np.arange(CELLS) - CELLS // 2)
    rows = np.clip(row - row % STRIDE + steps, 0, grid.shape[0] - 1)
    cols = np.clip(col - col % STRIDE + steps, 0, grid.shape[1] - 1)
    block = np.ix_(rows, cols)
    low, high, opacity = occluders(percept)
    ground, top = grid.elevation[block] - pose.z, high[block] - pose.z
    there = high[block] > low[block]
    dy = (grid.y_min + rows * grid.resolution)[:, None] - pose.y + np.zeros(CELLS)
    dx = (grid.x_min + cols * grid.resolution)[None, :] - pose.x + np.zeros((CELLS, 1))
    views = views_on_map(percept, np.nan_to_num(grid.elevation), 0.0)
    aside = [np.stack([view.x - pose.x - dx, view.y - pose.y - dy]) for view in views]
    distances = np.array([np.hypot(*offset) for offset in aside])
    nearest = np.argmin(distances, axis=0)
    offset = np.take_along_axis(np.array(aside), nearest[None, None], axis=0)[0]
    distance = np.maximum(np.min(distances, axis=0), 1e-6)
    eye = np.array([view.z for view in views])[nearest] - pose.z
    points = np.column_stack([(dx + pose.x).ravel(), (dy + pose.y).ravel(), np.full(dx.size, pose.z)])
    held = sum(view.holds(points).astype(float) for view in views)
    layers = [
        sensed[block], np.isnan(ground), grid.obstacle[block], np.nan_to_num(ground) / 4.0,
        np.where(there, np.clip(top, -4.0, 8.0), 0.0) / 4.0, there & ~grid.obstacle[block],
        np.where(there, 1.0 - opacity[block], 0.0), np.hypot(dx, dy) / 13.0, offset[0] / distance,
        offset[1] / distance, distance / 50.0, np.reshape(held, dx.shape) / 3.0,
        np.clip(eye, -8.0, 8.0) / 4.0,
    ]  # fmt: skip
    return Window(np.stack(layers).astype(np.float32), rows, cols)


class ExposureNetwork(nn.Module):
    """Layers (n, channels, 64, 64) to log-odds (n, 64, 64) of the share of the robot that is seen."""

    def __init__(self, widths: tuple[int, int, int] = WIDTHS):
        super().__init__()
        self.widths = widths
        first, second, third = widths
        self.enter = _block(len(CHANNELS), first)
        self.down = _block(first, second)
        self.bottom = _block(second, third)
        self.attention = Attention(third)
        self.rise = _block(third + second, second)
        self.leave = _block(second + first, first)
        self.last = nn.Conv2d(first, 1, 1)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)  # type: ignore[arg-type]

    def forward(self, layers: Tensor) -> Tensor:
        fine = self.enter(layers)
        half = self.down(nn.functional.max_pool2d(fine, 2))
        low = self.attention(self.bottom(nn.functional.max_pool2d(half, 2)))
        half = self.rise(torch.cat([nn.functional.interpolate(low, scale_factor=2.0), half], 1))
        fine = self.leave(torch.cat([nn.functional.interpolate(half, scale_factor=2.0), fine], 1))
        return _log_odds(layers[:, 0]) + self.last(fine)[:, 0]


def corrected_exposure(network: ExposureNetwork, percept: Percept, sensed: np.ndarray) -> np.ndarray:
    """`sensed` (rows, cols) float32 with what the network makes of it about the robot."""
    if not percept.observers:
        return sensed
    part = window(percept, sensed)
    with torch.inference_mode():
        chance = torch.sigmoid(network(torch.from_numpy(part.layers[None])))[0].numpy()
    corrected = sensed.copy()
    for row in range(STRIDE):
        for col in range(STRIDE):
            rows = np.minimum(part.rows + row, sensed.shape[0] - 1)
            cols = np.minimum(part.cols + col, sensed.shape[1] - 1)
            corrected[np.ix_(rows, cols)] = chance
    return corrected


def save_network(path: Path, network: ExposureNetwork) -> PolicyName:
    """Write the network's weights. Raises OSError."""
    about = {"architecture": ARCHITECTURE, "widths": json.dumps(network.widths)}
    return PolicyName(path.stem, write_tensors(path, weights(network), about))


def load_network(path: Path) -> tuple[ExposureNetwork, PolicyName]:
    """The network in a file, ready to be asked. Raises PolicyError where the file is truncated, not
    safetensors, of another architecture, or holds numbers that are not finite."""
    tensors, about, sha256 = read_tensors(path)
    if about.get("architecture") != ARCHITECTURE:
        kind = about.get("architecture", "none that it names")
        raise PolicyError(f"{path} holds weights of the architecture {kind}, not {ARCHITECTURE!r}")
    try:
        first, second, third = json.loads(about["widths"])
        if not all(type(width) is int and 1 <= width <= WIDEST for width in (first, second, third)):
            raise ValueError
    except (KeyError, TypeError, ValueError):
        raise PolicyError(f"{path} does not say how wide its network is") from None
    network = ExposureNetwork((first, second, third))
    load_weights(network, tensors, path)
    return network.eval(), PolicyName(path.stem, sha256)


def _block(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, padding=1), nn.ReLU(),
        nn.Conv2d(outputs, outputs, 3, padding=1), nn.ReLU(),
    )  # fmt: skip


def _log_odds(share: Tensor) -> Tensor:
    share = share.clamp(LEAST, 1.0 - LEAST)
    return torch.log(share) - torch.log1p(-share)


def turned(layers: np.ndarray, quarter: int, mirrored: bool) -> np.ndarray:
    """Layers (..., channels, 64, 64) as they would be in a world turned by quarters, then mirrored; for the
    target give them a leading axis of one channel."""
    out = np.rot90(layers, quarter, axes=(-2, -1)).copy()
    if out.shape[-3] == len(CHANNELS):
        cos, sin = out[..., 8, :, :].copy(), out[..., 9, :, :].copy()
        # Rows grow to the north: turning the picture from rows to columns turns the world clockwise.
        angle = -0.5 * math.pi * quarter
        out[..., 8, :, :] = math.cos(angle) * cos - math.sin(angle) * sin
        out[..., 9, :, :] = math.sin(angle) * cos + math.cos(angle) * sin
    if mirrored:
        out = out[..., ::-1].copy()
        if out.shape[-3] == len(CHANNELS):
            out[..., 8, :, :] *= -1.0
    return out
