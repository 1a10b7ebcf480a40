"""TERP's actor and critic with attention, as the CoverNav paper uses them.

Weerakoon et al. 2022 (TERP); Woo et al. 2018 (CBAM, the convolutional block attention module).

Narrowed against TERP, so that an update takes milliseconds on one core and both weigh 1.5 MB:

===================  ===============================  ==================================
layer                TERP                             here
===================  ===============================  ==================================
first convolution    1 → 8, 3 × 3, every cell         C → 8, 3 × 3, every second cell
attention            CBAM, reduction 4, 40 × 40       CBAM, reduction 4, 20 × 20
second convolution   8 → 4, 5 × 5, every cell         8 → 16, 4 × 4, every fourth place
vector branch        25 → 300 → 1224                  S → 64 → 128
joined               7000 → 3000 → 500 → 30 → 2       528 → 256 → 64 → 30 → 2
dropout              when driving, too, by oversight  none
===================  ===============================  ==================================
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from planner.attention_kernel import attend, attend_gradient, in_blocks, out_of_blocks

PATCH_CELLS = 40
"""Cells a side of the robot-centric layers, 0.5 m each."""

FEATURE_MAPS, FEATURE_CELLS = 8, 20
"""Channels after the attention, and places a side: each stands for 2 × 2 cells of the layers."""

BLOCK = 4
"""Places a side that the second convolution takes together."""


MOST_READ = 256


@dataclass(frozen=True)
class Architecture:
    """What a network reads, and its name in a checkpoint.

    channels : so many of the environment's layers, from the first on; state : so many of its state's numbers
    """

    channels: int = 1
    state: int = 25
    name: str = "terp_cbam"

    def __post_init__(self) -> None:
        """Raises ValueError for what no environment shows."""
        for count in (self.channels, self.state):
            if type(count) is not int or not 1 <= count <= MOST_READ:
                raise ValueError(f"a network reads 1 to {MOST_READ} layers and numbers, got {count!r}")


PAPER = Architecture()
"""What the paper's network reads: the elevation, and TERP's 25 numbers."""


class _Attend(torch.autograd.Function):
    """The compiled kernels as one differentiable operation."""

    @staticmethod
    def forward(ctx, features: Tensor, *parameters: Tensor) -> Tensor:
        given = [tensor.detach().numpy() for tensor in (features.contiguous(), *parameters)]
        out, *found = attend(*given)
        ctx.given, ctx.found = given, found
        return torch.from_numpy(out)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, slope: Tensor):  # type: ignore[override]
        features, w1, _, w2, _, kernel, _ = ctx.given
        slopes = attend_gradient(slope.contiguous().numpy(), features, w1, w2, kernel, *ctx.found)
        return tuple(torch.from_numpy(slope) for slope in slopes)


class _InBlocks(torch.autograd.Function):
    """Features (n, channels, rows, cols) as (n, rows / side, cols / side, channels · side²)."""

    @staticmethod
    def forward(ctx, features: Tensor, side: int) -> Tensor:
        ctx.side = side
        return torch.from_numpy(in_blocks(features.detach().contiguous().numpy(), side))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, slope: Tensor):  # type: ignore[override]
        return torch.from_numpy(out_of_blocks(slope.contiguous().numpy(), ctx.side)), None


class Attention(nn.Module):
    """CBAM on features (n, channels, rows, cols): weighs the channels by one perceptron on their means and on
    their maxima, added; then the places by a 3 × 3 convolution of the channels' mean and maximum there."""

    def __init__(self, channels: int = FEATURE_MAPS, reduction: int = 4):
        super().__init__()
        inner, outer = nn.Linear(channels, channels // reduction), nn.Linear(channels // reduction, channels)
        places = nn.Conv2d(2, 1, 3, padding=1)
        self.inner_weight, self.inner_bias = inner.weight, inner.bias
        self.outer_weight, self.outer_bias = outer.weight, outer.bias
        self.kernel = nn.Parameter(places.weight.detach()[0].clone())
        self.bias = nn.Parameter(places.bias.detach().clone())  # type: ignore[union-attr]

    def forward(self, features: Tensor) -> Tensor:
        return _Attend.apply(features, *self.parameters())  # type: ignore[return-value]


class Encoder(nn.Module):
    """Layers (n, channels, 40, 40) and state (n, state) to features (n, `width`)."""

    def __init__(self, architecture: Architecture):
        super().__init__()
        self.architecture = architecture
        self.first = nn.Conv2d(architecture.channels, FEATURE_MAPS, 3, stride=2, padding=1)
        self.attention = Attention()
        self.second = nn.Linear(FEATURE_MAPS * BLOCK**2, 16)
        self.vector = nn.Sequential(
            nn.Linear(architecture.state, 64), nn.ReLU(), nn.Linear(64, 128), nn.ReLU()
        )
        self.width = 16 * (FEATURE_CELLS // BLOCK) ** 2 + 128

    def features(self, layers: Tensor) -> Tensor:
        """(n, 8, 20, 20) features before the attention, none below zero."""
        return torch.relu(self.first(layers))

    def attend(self, layers: Tensor) -> Tensor:
        """(n, 8, 20, 20) features after the attention, none below zero."""
        return self.attention(self.features(layers))

    def forward(self, layers: Tensor, state: Tensor) -> Tensor:
        # A convolution whose blocks do not overlap is one product of matrices.
        blocks: Tensor = _InBlocks.apply(self.attend(layers), BLOCK)  # type: ignore[assignment]
        seen = torch.relu(self.second(blocks))
        return torch.cat([seen.flatten(1), self.vector(state)], 1)


def _joined(width: int, outputs: int) -> nn.Sequential:
    last = nn.Linear(30, outputs)
    # Lillicrap et al. 2016: begin with small actions and values.
    nn.init.uniform_(last.weight, -3e-3, 3e-3)
    nn.init.uniform_(last.bias, -3e-3, 3e-3)
    return nn.Sequential(
        nn.Linear(width, 256), nn.LayerNorm(256), nn.ReLU(),
        nn.Linear(256, 64), nn.LayerNorm(64), nn.ReLU(),
        nn.Linear(64, 30), nn.ReLU(),
        last,
    )  # fmt: skip


class Actor(nn.Module):
    """The policy: layers (n, channels, 40, 40), state (n, state) to actions (n, 2) within -1 and 1."""

    def __init__(self, architecture: Architecture = PAPER):
        super().__init__()
        self.architecture = architecture
        self.encoder = Encoder(architecture)
        self.head = _joined(self.encoder.width, 2)

    def forward(self, layers: Tensor, state: Tensor) -> Tensor:
        return torch.tanh(self.head(self.encoder(layers, state)))


class Critic(nn.Module):
    """The value of actions (n, 2): alike, with a branch for the action; returns (n,)."""

    def __init__(self, architecture: Architecture = PAPER):
        super().__init__()
        self.encoder = Encoder(architecture)
        self.action = nn.Sequential(nn.Linear(2, 64), nn.ReLU())
        self.head = _joined(self.encoder.width + 64, 1)

    def value(self, features: Tensor, action: Tensor) -> Tensor:
        """(n,) from the encoder's features (n, width): one look at a state serves several actions."""
        return self.head(torch.cat([features, self.action(action)], 1)).squeeze(1)

    def forward(self, layers: Tensor, state: Tensor, action: Tensor) -> Tensor:
        return self.value(self.encoder(layers, state), action)
