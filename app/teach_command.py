"""`covernav train --learner exposure`: teach the network that corrects the sensed exposure."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def add_arguments(train: argparse.ArgumentParser, whole: Callable[[int, int], Any]) -> None:
    """The options that only this learner has."""
    train.add_argument(
        "--learner", choices=["paper", "terp", "exposure", "ga_nav", "dwa_rl"], default="paper",
        help="the paper's (left out), TERP's, the network in covernav that corrects who it thinks sees it,"
        " GA-Nav's, which tells ground by its looks, or DWA-RL's, which chooses among the window's arcs",
    )  # fmt: skip
    train.add_argument("--scenes", type=whole(2, 100_000), help="to learn from, of exposure and ga_nav")
    train.add_argument("--held-out", type=whole(1, 10_000), help="scenes to validate on")
    train.add_argument("--epochs", type=whole(1, 10_000), help="of exposure and ga_nav")
    train.add_argument("--jobs", type=whole(1, 64), default=2, help="processes that collect")


def teach(arguments: argparse.Namespace) -> None:
    """Collect and learn; a folder that holds scenes already is gone on with. Raises OSError."""
    from tqdm import tqdm

    from planner.exposure_lessons import WEIGHTS, Lessons, collect, learn

    folder = arguments.out or Path("training-exposure")
    seed = 5000 if arguments.seed is None else arguments.seed
    lessons = Lessons(arguments.scenes or 400, arguments.held_out or 60, seed, arguments.epochs or 30)
    seeds = [seed for group in lessons.seeds for seed in group]
    gathered = collect(folder, seeds, arguments.jobs)
    for _ in tqdm(gathered, total=len(seeds), disable=None, unit="scene", file=sys.stderr):
        pass
    bar = tqdm(learn(folder, lessons), total=lessons.epochs, disable=None, unit="epoch", file=sys.stderr)
    best = None
    for now, better in bar:
        best = now if better else best
        bar.set_postfix_str(f"Brier {now.brier:.4f}, sensed {now.sensed_brier:.4f}")
    if best is None:
        print(f"nothing learnt in {folder}: no epoch did better than the map alone")
    else:
        print(f"Brier {best.brier:.4f}, the map alone {best.sensed_brier:.4f}; weights in {folder / WEIGHTS}")
