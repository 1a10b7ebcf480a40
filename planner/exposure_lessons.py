"""A whole training of the exposure network in a folder: samples by scene, the best weights so far, a card.

Samples that are there already are not collected again, so that a run that was cut off goes on.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch

from planner import scene_samples
from planner.checkpoint import write_file
from planner.exposure_learning import Sample, Score, fit, samples, score
from planner.exposure_network import ExposureNetwork, save_network
from planner.scene_samples import Lessons
from scenes.scenario import Family, ScenarioError

WEIGHTS, CARD = "covernav.safetensors", "covernav.json"
NAMES = ("layers", "target", "counts")

USUAL = Lessons(scenes=400, held_out=60, seed=5000, epochs=30)


def collect(folder: Path, seeds: Sequence[int], jobs: int) -> Iterator[int]:
    """Drive the scenes that are not in `folder` yet; yields each seed as it is there. Raises OSError."""
    return scene_samples.collect(folder, seeds, jobs, _taken)


def _taken(seed: int) -> dict[str, np.ndarray]:
    families = list(Family)
    try:
        taken = samples(families[seed % len(families)], seed)
    except ScenarioError:  # a seed without a mission in which cover matters
        taken = []
    return {name: np.array([getattr(sample, name) for sample in taken]) for name in NAMES}


def read(folder: Path, seeds: Sequence[int]) -> list[Sample]:
    """The samples of scenes that have been collected."""
    found = []
    for arrays in scene_samples.kept(folder, seeds, NAMES):
        found += map(Sample, arrays["layers"], arrays["target"], arrays["counts"])
    return found


def learn(folder: Path, lessons: Lessons) -> Iterator[tuple[Score, bool]]:
    """Train on what `collect` has put into `folder`; yields the validation's score after each epoch and
    whether it is the best so far, whose weights are in `WEIGHTS` and figures in `CARD`.

    Raises OSError, FileNotFoundError where a scene is missing."""
    torch.manual_seed(lessons.seed)
    network = ExposureNetwork()
    given, held_out = (read(folder, seeds) for seeds in lessons.seeds)
    best = score(network, held_out)
    for epoch, now in enumerate(fit(network, given, held_out, lessons.epochs, lessons.seed), 1):
        better = now.brier < best.brier
        if better:
            best = now
            figures = {
                "lessons": asdict(lessons), "epoch": epoch, "samples": len(given),
                "validation_samples": len(held_out), "validation": asdict(now),
            }  # fmt: skip
            save_network(folder / WEIGHTS, network)
            write_file(folder / CARD, json.dumps(figures, indent=1).encode())
        yield now, better
