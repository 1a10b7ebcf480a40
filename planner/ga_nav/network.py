"""The segmentation network: a MixVisionTransformer encoder (Xie et al. 2021, SegFormer) and the group-wise
attention head of GA-Nav (Guan et al. 2022), in plain PyTorch.

Half the widths of GA-Nav's encoder, on images of half the camera's size, so that it runs on one core while
driving. What that loses along edges comes back by a shallow path beside the encoder, two pixels a sample,
which GA-Nav lacks. The head's six attention heads stand for a group each.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from planner.checkpoint import PolicyError, PolicyName, load_weights, read_tensors, weights, write_tensors
from planner.ga_nav.groups import GROUPS

ARCHITECTURE = "ga_nav"
MEAN, SPREAD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of the colours that the network is fed, as is usual for this encoder."""

_MEAN, _SPREAD = (torch.tensor(each).view(1, 3, 1, 1) for each in (MEAN, SPREAD))


@dataclass(frozen=True)
class Shape:
    """widths, heads, reductions : of the four stages, channels, attention heads, and how many tokens a side
        of the image are merged for keys and values
    layers : of each stage; stem : pixels a token of the first
    decoder : channels of the head, a multiple of the number of groups
    detail : channels of the path beside the encoder
    """

    widths: tuple[int, ...] = (16, 32, 80, 128)
    heads: tuple[int, ...] = (1, 2, 5, 8)
    reductions: tuple[int, ...] = (8, 4, 2, 1)
    layers: int = 2
    stem: int = 4
    decoder: int = 48
    detail: int = 16


class PatchEmbedding(nn.Module):
    """Overlapping patches to normalised tokens, (n, channels, h, w) to (n, width, h / stride, w / stride)."""

    def __init__(self, channels: int, width: int, kernel: int, stride: int):
        super().__init__()
        self.project = nn.Conv2d(channels, width, kernel, stride, kernel // 2)
        self.norm = nn.LayerNorm(width)

    def forward(self, image: Tensor) -> Tensor:
        image = self.project(image)
        rows, cols = image.shape[-2:]
        return _image(self.norm(_tokens(image)), rows, cols)


class EfficientAttention(nn.Module):
    """Self-attention whose keys and values are merged over `reduction` × `reduction` tokens."""

    def __init__(self, width: int, heads: int, reduction: int):
        super().__init__()
        self.heads, self.reduction = heads, reduction
        self.query, self.pair = nn.Linear(width, width), nn.Linear(width, 2 * width)
        self.project = nn.Linear(width, width)
        if reduction > 1:
            self.merge = nn.Conv2d(width, width, reduction, reduction)
            self.norm = nn.LayerNorm(width)

    def forward(self, tokens: Tensor, rows: int, cols: int) -> Tensor:
        source = tokens
        if self.reduction > 1:
            source = self.norm(_tokens(self.merge(_image(tokens, rows, cols))))
        key, value = self.pair(source).chunk(2, -1)
        query, key, value = (_headed(each, self.heads) for each in (self.query(tokens), key, value))
        return self.project(F.scaled_dot_product_attention(query, key, value).transpose(1, 2).flatten(2))


class MixFeedForward(nn.Module):
    """Two layers with a depthwise 3 × 3 convolution between them, which tells a token where it is."""

    def __init__(self, width: int, expansion: int = 4):
        super().__init__()
        hidden = expansion * width
        self.rise, self.fall = nn.Linear(width, hidden), nn.Linear(hidden, width)
        self.mix = nn.Conv2d(hidden, hidden, 3, padding=1, groups=hidden)

    def forward(self, tokens: Tensor, rows: int, cols: int) -> Tensor:
        return self.fall(F.gelu(_tokens(self.mix(_image(self.rise(tokens), rows, cols)))))


class Layer(nn.Module):
    """Attention and feed-forward, each behind a LayerNorm and beside a shortcut."""

    def __init__(self, width: int, heads: int, reduction: int):
        super().__init__()
        self.before, self.between = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attention = EfficientAttention(width, heads, reduction)
        self.feed = MixFeedForward(width)

    def forward(self, tokens: Tensor, rows: int, cols: int) -> Tensor:
        tokens = tokens + self.attention(self.before(tokens), rows, cols)
        return tokens + self.feed(self.between(tokens), rows, cols)


class Stage(nn.Module):
    def __init__(self, channels: int, width: int, heads: int, reduction: int, layers: int, stride: int):
        super().__init__()
        self.embed = PatchEmbedding(channels, width, 7 if channels == 3 else 3, stride)
        self.layers = nn.ModuleList(Layer(width, heads, reduction) for _ in range(layers))
        self.norm = nn.LayerNorm(width)

    def forward(self, image: Tensor) -> Tensor:
        image = self.embed(image)
        rows, cols = image.shape[-2:]
        tokens = _tokens(image)
        for layer in self.layers:
            tokens = layer(tokens, rows, cols)
        return _image(self.norm(tokens), rows, cols)


class GroupAttention(nn.Module):
    """One attention head a group: (n, channels, h, w) to the attended (n, channels, h, w), and how strongly
    each token attends to itself in each (n, groups, h, w): the scaled logits of the main diagonal."""

    def __init__(self, channels: int):
        super().__init__()
        self.triple, self.project = nn.Linear(channels, 3 * channels), nn.Linear(channels, channels)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        rows, cols = image.shape[-2:]
        query, key, value = (_headed(each, len(GROUPS)) for each in self.triple(_tokens(image)).chunk(3, -1))
        attended = F.scaled_dot_product_attention(query, key, value)
        itself = (query * key).sum(-1) / math.sqrt(query.shape[-1])
        attended = self.project(attended.transpose(1, 2).flatten(2))
        return _image(attended, rows, cols), itself.reshape(len(image), len(GROUPS), rows, cols)


class GaNav(nn.Module):
    """Colours (n, 3, h, w), 0 to 1, to logits (n, 6, h, w) of the groups; with `maps` also the group-wise
    attention maps (n, 6, h', w') as logits, which training supervises.

    The encoder's features of all scales are fused at the finest; the group-wise attention looks at them eight
    pixels a token, and what it finds is joined to them again.
    """

    def __init__(self, shape: Shape | None = None):
        super().__init__()
        self.shape = shape = shape or Shape()
        inputs, strides = (3, *shape.widths), (shape.stem, 2, 2, 2)
        stages = zip(inputs, shape.widths, shape.heads, shape.reductions, strides, strict=False)
        self.stages = nn.ModuleList(
            Stage(channels, width, heads, reduction, shape.layers, stride)
            for channels, width, heads, reduction, stride in stages
        )
        size, fine, last = shape.decoder, shape.detail, shape.decoder // 2
        # Fusing by a convolution over all scales at once is the sum of one over each.
        self.fuse = nn.ModuleList(nn.Conv2d(width, size, 1, bias=False) for width in shape.widths)
        self.fused = nn.Sequential(nn.BatchNorm2d(size), nn.ReLU())
        self.attention = GroupAttention(size)
        self.join = nn.Sequential(
            nn.Conv2d(2 * size, size, 1, bias=False), nn.BatchNorm2d(size), nn.ReLU(),
            nn.Conv2d(size, size, 3, padding=1, groups=size, bias=False), nn.BatchNorm2d(size), nn.ReLU(),
        )  # fmt: skip
        self.detail = nn.Sequential(
            nn.Conv2d(3, fine, 3, 2, 1, bias=False), nn.BatchNorm2d(fine), nn.ReLU(),
            nn.Conv2d(fine, fine, 3, padding=1, bias=False), nn.BatchNorm2d(fine), nn.ReLU(),
        )  # fmt: skip
        self.narrow = nn.Conv2d(size, last, 1, bias=False)
        self.blend = nn.Conv2d(fine, last, 1, bias=False)
        self.sharpen = nn.Sequential(
            nn.BatchNorm2d(last), nn.ReLU(),
            nn.Conv2d(last, last, 3, padding=1, groups=last, bias=False), nn.BatchNorm2d(last), nn.ReLU(),
        )  # fmt: skip
        self.classify = nn.Conv2d(last, len(GROUPS), 1)

    def forward(self, image: Tensor) -> Tensor:
        return self.maps(image)[0]

    def maps(self, image: Tensor) -> tuple[Tensor, Tensor]:
        features, scaled = [], (image - _MEAN) / _SPREAD
        detail = self.detail(scaled)
        for stage in self.stages:
            scaled = stage(scaled)
            features.append(scaled)
        size = features[0].shape[-2:]
        fused = sum(_resized(fuse(each), size) for fuse, each in zip(self.fuse, features, strict=True))
        fused = self.fused(fused)
        attended, groups = self.attention(F.adaptive_avg_pool2d(fused, features[2].shape[-2:]))
        joined = self.join(torch.cat([fused, _resized(attended, size)], 1))
        sharp = self.sharpen(_resized(self.narrow(joined), detail.shape[-2:]) + self.blend(detail))
        return _resized(self.classify(sharp), image.shape[-2:]), groups


def segment(network: GaNav, rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a camera's image shows: labels (h / 2, w / 2) uint8 and their probability (h / 2, w / 2) float32.

    rgb : (h, w, 3) uint8, sides even; it is halved by averaging first
    """
    with torch.inference_mode():
        whole = torch.from_numpy(np.ascontiguousarray(rgb.transpose(2, 0, 1)))[None].float()
        chance = network(F.avg_pool2d(whole, 2) / 255.0).softmax(1)[0]
        best, label = chance.max(0)
    return label.numpy().astype(np.uint8), best.numpy()


def save_network(path: Path, network: GaNav) -> PolicyName:
    """Write the network's weights. Raises OSError."""
    tensors = {name: value for name, value in weights(network).items() if value.ndim}
    about = {"architecture": ARCHITECTURE, "shape": json.dumps(asdict(network.shape))}
    return PolicyName(path.stem, write_tensors(path, tensors, about))


def load_network(path: Path) -> tuple[GaNav, PolicyName]:
    """The network in a file, ready to look. Raises PolicyError where the file is truncated, not safetensors,
    of another architecture, or holds numbers that are not finite."""
    tensors, about, sha256 = read_tensors(path)
    if about.get("architecture") != ARCHITECTURE:
        kind = about.get("architecture", "none that it names")
        raise PolicyError(f"{path} holds weights of the architecture {kind}, not {ARCHITECTURE!r}")
    try:
        fields = json.loads(about["shape"])
        sides = {name: tuple(fields[name]) for name in ("widths", "heads", "reductions")}
        network = GaNav(Shape(**{**fields, **sides}))
    except (KeyError, TypeError, ValueError, RuntimeError):
        raise PolicyError(f"{path} does not say what shape its network has") from None
    # How many batches the statistics are of is of no use any more, and not in the file.
    tensors |= {name: value for name, value in weights(network).items() if not value.ndim}
    load_weights(network, tensors, path)
    return network.eval(), PolicyName(path.stem, sha256)


def _tokens(image: Tensor) -> Tensor:
    return image.flatten(2).transpose(1, 2)


def _image(tokens: Tensor, rows: int, cols: int) -> Tensor:
    return tokens.transpose(1, 2).unflatten(2, (rows, cols))


def _headed(tokens: Tensor, heads: int) -> Tensor:
    return tokens.unflatten(2, (heads, -1)).transpose(1, 2)


def _resized(image: Tensor, size) -> Tensor:
    return F.interpolate(image, size=tuple(size), mode="bilinear", align_corners=False)
