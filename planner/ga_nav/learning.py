"""Teaches the network: cross entropy over the groups, and GA-Nav's group-wise attention loss."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from planner.ga_nav.groups import GROUPS, IGNORED
from planner.ga_nav.network import GaNav
from planner.learning_errors import check_finite

ATTENTION_WEIGHT = 0.3
"""Of the group-wise attention loss beside the cross entropy."""


@dataclass(frozen=True, eq=False)
class Images:
    """rgb : (n, h, w, 3) uint8; groups : (n, h, w) uint8 labels, `IGNORED` where a pixel counts nowhere"""

    rgb: np.ndarray
    groups: np.ndarray

    def __len__(self) -> int:
        return len(self.rgb)


@dataclass(frozen=True)
class Score:
    """iou : intersection over union by group, over all pixels of all images; None for a group that neither is
        there nor is said to be
    accuracy : share of the pixels whose group is right
    """

    iou: tuple[float | None, ...]
    accuracy: float

    @property
    def mean_iou(self) -> float:
        """Over the groups that there are."""
        return float(np.mean([each for each in self.iou if each is not None]))

    def document(self) -> dict[str, float | None]:
        """Per cent, by group and over all."""
        parts = {f"iou_{group.value}": each for group, each in zip(GROUPS, self.iou, strict=True)}
        rows = {"miou": self.mean_iou, **parts, "accuracy": self.accuracy}
        return {name: None if each is None else round(100.0 * each, 2) for name, each in rows.items()}


@dataclass(frozen=True)
class Course:
    """How it is taught; seed : of the order and the changes to images; crop : rows and columns of an image
    that are learnt from at once"""

    epochs: int
    seed: int
    rate: float = 3e-3
    decay: float = 0.01
    batch: int = 8
    crop: tuple[int, int] = (96, 128)


def score(network: GaNav, images: Images, batch: int = 16) -> Score:
    """How well the network does on images that it has not learnt from."""
    return from_confusion(confusion(network, images, batch))


def confusion(network: GaNav, images: Images, batch: int = 16) -> np.ndarray:
    """(6, 6) pixels by true group, then by what the network says."""
    network.eval()
    count = len(GROUPS)
    table = np.zeros((count, count), np.int64)
    for begin in range(0, len(images), batch):
        some = slice(begin, begin + batch)
        with torch.inference_mode():
            said = network(_colours(images.rgb[some])).argmax(1).numpy()
        true = images.groups[some].astype(np.int64)
        counts = true != IGNORED
        table += np.bincount(count * true[counts] + said[counts], minlength=count**2).reshape(count, count)
    return table


def from_confusion(table: np.ndarray) -> Score:
    """The score of a confusion matrix (6, 6), true group first."""
    right, union = np.diag(table), table.sum(0) + table.sum(1) - np.diag(table)
    iou = tuple(float(r / u) if u else None for r, u in zip(right, union, strict=True))
    return Score(iou, float(right.sum() / max(table.sum(), 1)))


def fit(network: GaNav, given: Images, held_out: Images, course: Course) -> Iterator[Score]:
    """Train; yields the score on `held_out` after each epoch.

    AdamW with one cosine after a short rise. Images are cut, mirrored and their light and colours changed
    at random. Rarer groups weigh more, by the root of how rare they are.
    """
    rng = np.random.default_rng(course.seed)
    parameters = list(network.parameters())
    decayed = [each for each in parameters if each.ndim > 1]
    others = [each for each in parameters if each.ndim <= 1]
    parts = [{"params": decayed, "weight_decay": course.decay}, {"params": others, "weight_decay": 0.0}]
    optimiser = torch.optim.AdamW(parts, course.rate)
    rounds = -(-len(given) // course.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, course.rate, course.epochs * rounds, pct_start=0.05, cycle_momentum=False
    )
    weight = _weights(given.groups)
    for epoch in range(course.epochs):
        network.train()
        for some in np.array_split(rng.permutation(len(given)), rounds):
            colours, groups = _changed(given.rgb[some], given.groups[some], course.crop, rng)
            logits, attention = network.maps(colours)
            optimiser.zero_grad()
            loss = F.cross_entropy(logits, groups, weight, ignore_index=IGNORED)
            heeded = attention_loss(attention, groups)
            check_finite({"segmentation": loss.item(), "attention": heeded.item()}, f"{epoch} epochs")
            (loss + ATTENTION_WEIGHT * heeded).backward()
            torch.nn.utils.clip_grad_norm_(parameters, 1.0)
            optimiser.step()
            schedule.step()
        yield score(network, held_out)


def attention_loss(attention: Tensor, groups: Tensor) -> Tensor:
    """Binary cross entropy of each group's attention map, logits (n, 6, h', w'), against the share of each
    of its tokens that belongs to the group. groups : (n, h, w) labels."""
    counts = (groups != IGNORED).float()[:, None]
    present = F.one_hot(groups.where(groups != IGNORED, 0), len(GROUPS)).permute(0, 3, 1, 2).float() * counts
    size = int(attention.shape[-2]), int(attention.shape[-1])
    there, known = F.adaptive_avg_pool2d(present, size), F.adaptive_avg_pool2d(counts, size)
    share = there / known.clamp(min=1e-6)
    losses = F.binary_cross_entropy_with_logits(attention, share, reduction="none") * known
    return losses.sum() / (len(GROUPS) * known.sum()).clamp(min=1.0)


def _weights(groups: np.ndarray) -> Tensor:
    """(6,) of mean one over the pixels: the root of a group's rarity."""
    counts = np.bincount(groups.ravel(), minlength=256)[: len(GROUPS)].astype(float)
    weight = 1.0 / np.sqrt(np.maximum(counts, 0.001 * counts.sum()))
    return torch.tensor(weight * counts.sum() / (weight * counts).sum(), dtype=torch.float32)


def _changed(
    rgb: np.ndarray, groups: np.ndarray, crop: tuple[int, int], rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """A part of each image in other light: mirrored or not, its brightness and colour balance changed."""
    count, rows, cols = groups.shape
    top, left = rng.integers(max(rows - crop[0], 0) + 1), rng.integers(max(cols - crop[1], 0) + 1)
    part = np.s_[:, top : top + crop[0], left : left + crop[1]]
    rgb, groups = rgb[part], groups[part]
    mirrored = rng.random(count) < 0.5
    rgb = np.where(mirrored[:, None, None, None], rgb[:, :, ::-1], rgb)
    groups = np.where(mirrored[:, None, None], groups[:, :, ::-1], groups)
    drawn = np.exp(rng.normal(0.0, (0.06, 0.015, 0.015, 0.015), (count, 4)))
    gain = torch.from_numpy(drawn.astype(np.float32))
    shift = torch.from_numpy(rng.normal(0.0, 0.02, (count, 1, 1, 1)).astype(np.float32))
    colours = _colours(rgb) * (gain[:, :1] * gain[:, 1:])[:, :, None, None] + shift
    return colours.clamp(0.0, 1.0), torch.from_numpy(groups.astype(np.int64))


def _colours(rgb: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(rgb.transpose(0, 3, 1, 2))).float() / 255.0
