"""`covernav train --learner ga_nav`: teach the network that tells groups of ground in a colour image."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from app.output import learning_in


def add_arguments(train: argparse.ArgumentParser) -> None:
    """The options that only this learner has."""
    train.add_argument(
        "--dataset", choices=["rugd", "rellis"],
        help="learn ga_nav from real images instead of rendered scenes: RUGD or RELLIS-3D",
    )  # fmt: skip
    train.add_argument(
        "--begin-with", type=Path, metavar="FILE", help="weights of ga_nav to learn on from; drawn ones else"
    )
    train.add_argument("--data", type=Path, metavar="DIR", help="the folder that holds the data set")


def teach(arguments: argparse.Namespace) -> None:
    """Collect and learn; a folder that holds scenes already is gone on with.

    Raises TrainingRefusal for what cannot be asked or read, TrainingError where the folder cannot be written.
    """
    from planner.learning_errors import TrainingRefusal

    if (arguments.dataset is None) != (arguments.data is None):
        raise TrainingRefusal("--dataset and --data go together: which data set, and where it lies")
    folder = arguments.out or Path("training-ga_nav")
    with learning_in(folder, "ga_nav"):
        _learn(arguments, folder)


def _learn(arguments: argparse.Namespace, folder: Path) -> None:
    import torch
    from tqdm import tqdm

    from planner.ga_nav.learning import Course
    from planner.ga_nav.lessons import WEIGHTS, Lessons, learn

    torch.set_num_threads(1)
    usual = Lessons()
    seed = usual.seed if arguments.seed is None else arguments.seed
    course = Course(arguments.epochs or usual.epochs, seed)
    scenes, held_out = arguments.scenes or usual.scenes, arguments.held_out or usual.held_out
    lessons = Lessons(scenes, held_out, seed, course.epochs)
    if arguments.dataset is None:
        split, about = _scenes(folder, lessons, arguments.jobs or 2)
    else:
        split, about = _data_set(arguments)
    begun = arguments.begin_with
    if begun is not None:
        about |= _beginning(begun, about)
    epochs = learn(folder, split, course, about, begun)
    bar = tqdm(epochs, total=course.epochs, disable=None, unit="epoch", file=sys.stderr)
    best = 0.0
    for now, _ in bar:
        best = max(best, now.mean_iou)
        bar.set_postfix_str(f"mIoU {100 * now.mean_iou:.1f} %, best {100 * best:.1f} %")
    print(f"mIoU {100 * best:.1f} % on images held out; weights in {folder / WEIGHTS}")


def _beginning(weights: Path, about: dict[str, Any]) -> dict[str, Any]:
    """The card's words on the weights that were begun with, by their own card where there is one."""
    words: dict[str, Any] = {"command": f"{about['command']} --begin-with {weights.name}"}
    card = weights.with_suffix(".json")
    if card.is_file():
        before = json.loads(card.read_text("utf-8"))
        words["begun_with"] = {name: before.get(name) for name in ("sha256", "command", "steps")}
    return words


def _scenes(folder: Path, lessons: Any, jobs: int) -> tuple[Any, dict[str, Any]]:
    from tqdm import tqdm

    from planner.ga_nav.lessons import collect, lessons_split

    seeds = [seed for group in lessons.seeds for seed in group]
    for _ in tqdm(
        collect(folder, seeds, jobs), total=len(seeds), disable=None, unit="scene", file=sys.stderr
    ):
        pass
    return lessons_split(folder, lessons), lessons.about


def _data_set(arguments: argparse.Namespace) -> tuple[Any, dict[str, Any]]:
    from planner.ga_nav.datasets import DataSet, Part, read_part
    from planner.ga_nav.learning import Images
    from planner.ga_nav.lessons import Split

    kind = DataSet(arguments.dataset)
    parts = [Images(*read_part(kind, arguments.data, part)) for part in Part]
    epochs = "" if arguments.epochs is None else f" --epochs {arguments.epochs}"
    about = {
        "command": f"covernav train --learner ga_nav --dataset {kind.value} --data DIR{epochs}",
        "data": f"{kind.value}, its own parts for training, validation and test",
    }
    return Split(*parts), about
