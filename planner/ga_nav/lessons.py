"""A whole training of GA-Nav's network in a folder: images by scene, the best weights so far, a card.

Images that are there already are not rendered again, so that a run that was cut off goes on.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from planner import scene_samples
from planner.checkpoint import write_file
from planner.ga_nav.images import Sample, samples
from planner.ga_nav.learning import Course, Images, Score, fit, score
from planner.ga_nav.network import GaNav, load_network, save_network
from scenes.scenario import Family, ScenarioError

WEIGHTS, CARD = "ga_nav.safetensors", "ga_nav.json"


@dataclass(frozen=True)
class Lessons:
    """seed : of the first scene, the weights and the order of the images; scene i has seed + i and the
    terrains in turn. After the `scenes` that it learns from come `held_out` to choose the best epoch by, and
    as many for the card's figures alone.
    """

    scenes: int = 120
    held_out: int = 20
    seed: int = 7000
    epochs: int = 12

    @property
    def seeds(self) -> tuple[range, range, range]:
        """Of the scenes learnt from, for validation, and for the figures."""
        last = self.seed + self.scenes
        chosen = last + self.held_out
        return range(self.seed, last), range(last, chosen), range(chosen, chosen + self.held_out)

    @property
    def about(self) -> dict[str, Any]:
        """The card's words on where the images come from."""
        usual = Lessons()
        changed = [
            f" --{name.replace('_', '-')} {value}"
            for name, value in asdict(self).items()
            if value != getattr(usual, name)
        ]
        return {
            "command": "covernav train --learner ga_nav" + "".join(changed),
            "data": "images of the semantic camera, rendered at 160 × 120 under drawn light, season, weather"
            f" and lens; ten of each scene, the four terrains in turn, seeds {self.seed} to"
            f" {self.seed + self.scenes - 1} to learn from, then {self.held_out} each to validate and test",
        }


def collect(folder: Path, seeds: Sequence[int], jobs: int) -> Iterator[int]:
    """Render the scenes that are not in `folder` yet; yields each seed as it is there. Raises OSError."""
    return scene_samples.collect(folder, seeds, jobs, _taken)


def _taken(seed: int) -> dict[str, np.ndarray]:
    families = list(Family)
    try:
        images = _stacked(samples(families[seed % len(families)], seed))
    except ScenarioError:  # a seed that gives no scene
        images = _stacked([])
    return {"rgb": images.rgb, "groups": images.groups}


def read(folder: Path, seeds: Sequence[int]) -> Images:
    """The images of scenes that have been rendered. Raises FileNotFoundError where one is missing."""
    found: list[Sample] = []
    for arrays in scene_samples.kept(folder, seeds, ("rgb", "groups")):
        found += map(Sample, arrays["rgb"], arrays["groups"])
    return _stacked(found)


@dataclass(frozen=True)
class Split:
    """What is learnt from, what the best epoch is chosen by, and what gives the figures."""

    given: Images
    validation: Images
    test: Images


def lessons_split(folder: Path, lessons: Lessons) -> Split:
    return Split(*(read(folder, seeds) for seeds in lessons.seeds))


def learn(
    folder: Path, split: Split, course: Course, about: dict[str, Any], begun: Path | None = None
) -> Iterator[tuple[Score, bool]]:
    """Train; yields the validation's score after each epoch and whether it is the best so far, whose weights
    are in `WEIGHTS`. At the end `CARD` has the best one's figures on both held-out parts, and `about`.

    begun : weights to begin with instead of drawn ones
    Raises OSError, PolicyError where there are no such weights."""
    torch.manual_seed(course.seed)
    folder.mkdir(parents=True, exist_ok=True)
    network, best, chosen = GaNav() if begun is None else load_network(begun)[0], None, 0
    for epoch, now in enumerate(fit(network, split.given, split.validation, course), 1):
        better = best is None or now.mean_iou > best.mean_iou
        if better:
            best, chosen = now, epoch
            save_network(folder / WEIGHTS, network)
        yield now, better
    if best is None:
        return
    network, name = load_network(folder / WEIGHTS)
    card = {
        "policy": name.name, "sha256": name.sha256, **about, "seed": course.seed,
        "steps": f"epoch {chosen} of {course.epochs}, {len(split.given)} images an epoch",
        "figures": {
            "validation": best.document() | {"images": len(split.validation)},
            "test": score(network, split.test).document() | {"images": len(split.test)},
        },
        "course": asdict(course),
    }  # fmt: skip
    write_file(folder / CARD, json.dumps(card, indent=1).encode())


def _stacked(taken: Sequence[Sample]) -> Images:
    if not taken:
        return Images(np.zeros((0, 120, 160, 3), np.uint8), np.zeros((0, 120, 160), np.uint8))
    return Images(np.stack([each.rgb for each in taken]), np.stack([each.groups for each in taken]))
