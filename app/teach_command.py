"""`covernav train --learner habits` and `exposure`: teach what covernav can learn."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.output import learning_in


def add_arguments(train: argparse.ArgumentParser, whole: Callable[[int, int], Any]) -> None:
    """The options that only this learner has."""
    train.add_argument(
        "--learner", choices=["paper", "terp", "habits", "exposure", "ga_nav", "dwa_rl"], default="paper",
        help="the paper's (left out), TERP's, the network in covernav that knows how people and vehicles go"
        " on, one that corrects who it thinks sees it, GA-Nav's, which tells ground by its looks, or"
        " DWA-RL's, which chooses among the window's arcs",
    )  # fmt: skip
    scenes = "to learn from, of habits, exposure and ga_nav"
    train.add_argument("--scenes", type=whole(2, 100_000), help=scenes)
    train.add_argument("--held-out", type=whole(1, 10_000), help="scenes to validate on")
    train.add_argument("--epochs", type=whole(1, 10_000), help="of habits, exposure and ga_nav")
    train.add_argument("--jobs", type=whole(1, 64), help="processes that collect those scenes; 2 usually")


def teach(arguments: argparse.Namespace) -> None:
    """Collect and learn; a folder that holds scenes already is gone on with.

    Raises TrainingRefusal for a folder that cannot be, TrainingError where it cannot be written."""
    folder = arguments.out or Path(f"training-{arguments.learner}")
    with learning_in(folder, arguments.learner):
        _teach(arguments, folder)


def _teach(arguments: argparse.Namespace, folder: Path) -> None:
    import torch
    from tqdm import tqdm

    torch.set_num_threads(1)  # the same weights whatever the machine
    if arguments.learner == "habits":
        from planner import habit_lessons as lessons
    else:
        from planner import exposure_lessons as lessons
    asked = {name: getattr(arguments, name) for name in ("scenes", "held_out", "seed", "epochs")}
    course = replace(lessons.USUAL, **{name: value for name, value in asked.items() if value is not None})
    seeds = [seed for group in course.seeds for seed in group]
    gathered = lessons.collect(folder, seeds, arguments.jobs or 2)
    for _ in tqdm(gathered, total=len(seeds), disable=None, unit="scene", file=sys.stderr):
        pass
    learnt = lessons.learn(folder, course)
    bar = tqdm(learnt, total=course.epochs, disable=None, unit="epoch", file=sys.stderr)
    best = None
    for now, better in bar:
        best = now if better else best
        bar.set_postfix_str(now.words)
    if best is None:
        print(f"nothing learnt in {folder}: no epoch did better than without a network")
    else:
        print(f"{best.words}; weights in {folder / lessons.WEIGHTS}")
