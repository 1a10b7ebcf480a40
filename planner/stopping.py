"""How far the Husky rolls on once it is told to stop, learnt from its own stops.

On level ground a skid-steered robot stops within a few decimetres, downhill later, uphill earlier. A small
network gives the way that half of its stops and nineteen in twenty do not exceed; before it has learnt
something it knows the driver's own gentle braking alone, for its last layer begins with zeros.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from planner.checkpoint import PolicyError, PolicyName, load_weights, read_tensors, weights, write_tensors
from scenes.pose import Pose, Twist

ARCHITECTURE = "stopping_mlp"
FEATURES = ("speed", "rise", "bank", "yaw rate")
QUANTILES = (0.5, 0.95)
WIDTH = 24

GENTLE = 0.5
"""m/s² that the untaught network believes in, as `planner.driver` brakes by itself."""


def features(pose: Pose, twist: Twist) -> np.ndarray:
    """(4,) float32 of a robot that drives forward: m/s, sines of the slope along and across, rad/s."""
    along = -math.sin(pose.pitch)
    across = math.sin(pose.roll) * math.cos(pose.pitch)
    return np.array([twist.v, along, across, twist.w], np.float32)


class StoppingNetwork(nn.Module):
    """`FEATURES` (n, 4) to metres (n, 2), one for each of `QUANTILES`, never less for the second."""

    def __init__(self) -> None:
        super().__init__()
        self.hidden = nn.Sequential(
            nn.Linear(len(FEATURES), WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh()
        )
        self.last = nn.Linear(WIDTH, len(QUANTILES))
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(self, given: Tensor) -> Tensor:
        # What lies to the left is as what lies to the right.
        even = torch.cat([given[:, :2], given[:, 2:].abs()], 1)
        gentle = given[:, :1].clamp(min=0.0) ** 2 / (2.0 * GENTLE)
        ways = gentle * torch.exp(self.last(self.hidden(even)))
        return torch.cummax(ways, 1).values


class LearnedStopping:
    """Answers for one robot at a time."""

    def __init__(self, network: StoppingNetwork):
        self._network = network.eval()

    def ways(self, pose: Pose, twist: Twist) -> np.ndarray:
        """(2,) metres along its heading that a robot told to stop here rolls on, by `QUANTILES`."""
        with torch.inference_mode():
            return self._network(torch.from_numpy(features(pose, twist)[None]))[0].numpy()


def save_stopping(path: Path, network: StoppingNetwork) -> PolicyName:
    """Write the network's weights. Raises OSError."""
    return PolicyName(path.stem, write_tensors(path, weights(network), {"architecture": ARCHITECTURE}))


def load_stopping(path: Path) -> tuple[LearnedStopping, PolicyName]:
    """What a file has learnt. Raises PolicyError where it is truncated, not safetensors, of another
    architecture, or holds numbers that are not finite."""
    tensors, about, sha256 = read_tensors(path)
    if about.get("architecture") != ARCHITECTURE:
        kind = about.get("architecture", "none that it names")
        raise PolicyError(f"{path} holds weights of the architecture {kind}, not {ARCHITECTURE!r}")
    network = StoppingNetwork()
    load_weights(network, tensors, path)
    return LearnedStopping(network), PolicyName(path.stem, sha256)
