"""`covernav train --learner dwa_rl`: teach the policy that chooses among the dynamic window's velocities."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.output import held, learning_in

TEST_DRIVES = 100


def add_arguments(train: argparse.ArgumentParser, whole: Callable[[int, int], Any]) -> None:
    """The options that only this learner has."""
    train.add_argument("--decisions", type=whole(1, 100_000_000), help="to learn from, of dwa_rl")


def teach(arguments: argparse.Namespace) -> None:
    """Learn, keeping the best policy so far; to interrupt it is to stop there.

    Raises TrainingRefusal for a folder that holds something, TrainingError where it cannot be written."""
    from tqdm import tqdm

    from planner.dwa_rl_network import load_window_policy
    from planner.dwa_rl_training import MotionLessons, compare, teach_motion
    from planner.learning_errors import TrainingRefusal

    folder = arguments.out or Path("training-dwa_rl")
    usual = MotionLessons()
    lessons = MotionLessons(arguments.decisions or usual.decisions, arguments.seed or 0)
    weights = folder / "dwa_rl.safetensors"
    with learning_in(folder, "dwa_rl"):
        if held(folder):
            raise TrainingRefusal(f"{folder} is not empty; name another folder with --out")
        (folder / "settings.json").write_text(json.dumps(asdict(lessons), indent=1) + "\n", "utf-8")
        bar = tqdm(total=lessons.decisions, disable=None, unit="decision", file=sys.stderr)
        with bar, (folder / "rounds.jsonl").open("w", encoding="utf-8") as curve:
            for now in teach_motion(weights, lessons):
                curve.write(json.dumps(asdict(now)) + "\n")
                curve.flush()
                bar.set_postfix_str(f"reward {now.total:.1f}, success {now.success:.0%}")
                bar.update(now.decisions - bar.n)
        found = compare(load_window_policy(weights)[0], TEST_DRIVES, lessons.seed)
        test = {"drives": TEST_DRIVES} | {name: asdict(judged) for name, judged in found.items()}
        (folder / "test.json").write_text(json.dumps(test, indent=1) + "\n", "utf-8")
    print(f"On {TEST_DRIVES} other drives in the same world, by the best policy, {weights}, and without it:")
    for name, judged in found.items():
        print(
            f"{name:8}arrives in {judged.success:.0%}, collides in {judged.collisions:.0%},"
            f" {judged.seconds:.1f} s"
        )
