"""Teaches how people and vehicles go on: those that cross generated scenes, watched by somebody who loses
sight of them now and then, and at each moment whether they turn within the next half second."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from planner import scene_samples
from planner.checkpoint import write_file
from planner.habits import BINS, HabitNetwork, bin_of, save_habits
from planner.learning_errors import check_finite
from planner.scene_samples import Lessons
from planner.walks import FEATURES, STEP, TURNED, Walks
from scenes.crossings import crossing_traffic
from scenes.families import generate
from scenes.pose import wrap_angle
from scenes.scenario import Family, MovingObstacle, ObstacleKind

WEIGHTS, CARD = "covernav.safetensors", "covernav.json"

USUAL = Lessons(scenes=96, held_out=24, seed=5000, epochs=40)

PEOPLE, VEHICLES = 6, 3
"""In a scene, at most."""

WATCHED = 180
"""Steps for which they are watched."""

IN_SIGHT, OUT_OF_SIGHT = (5.0, 40.0), (2.0, 15.0)
"""Least and most seconds at a time."""

AS_BEFORE = 0.8, math.radians(15.0)
"""Metres from where it turned before, and radians beside how it did, for a turn to be the same again."""

BATCH = 1024


@dataclass(frozen=True)
class Score:
    """Mean log-losses on the held-out steps, in nats: of whether there is a turn, and, where there is, of
    which; and of guessing the shares of the steps that were learnt from instead."""

    turn: float
    angle: float
    usual_turn: float
    usual_angle: float

    @property
    def total(self) -> float:
        return self.turn + self.angle

    @property
    def words(self) -> str:
        """For people."""
        return (
            f"log-loss of a turn {self.turn:.3f} (its share {self.usual_turn:.3f}),"
            f" of its angle {self.angle:.2f} ({self.usual_angle:.2f})"
        )


def collect(folder: Path, seeds: Sequence[int], jobs: int) -> Iterator[int]:
    """Watch the scenes that are not in `folder` yet; yields each seed as it is there. Raises OSError."""
    return scene_samples.collect(folder, seeds, jobs, steps)


def steps(seed: int) -> dict[str, np.ndarray]:
    """features : (n, FEATURES) float32; kinds : (n,) int8, -1 for no turn within the next `STEP`, else which
    of `BINS` its angle is in, or `BINS` for the same again."""
    rng, walkers = np.random.default_rng(seed), _walkers(seed)
    given, kinds = [np.zeros((0, len(FEATURES)), np.float32)], [np.zeros(0, np.int8)]
    if walkers:
        begun_s = rng.uniform(0.0, 120.0, len(walkers))
        in_sight = _sight(rng, len(walkers))
        walks = Walks.unseen(np.array([walker.kind is ObstacleKind.VEHICLE for walker in walkers]))
        now = _motion(walkers, begun_s)
        for step, seen in enumerate(in_sight):
            then = _motion(walkers, begun_s + STEP * (step + 1))
            walks.see(begun_s + STEP * step, now[:, :2], now[:, 2:4], seen)
            known = seen & (walks.speed > 0.0)
            given.append(walks.features()[known])
            kinds.append(_kinds(walks, np.asarray(wrap_angle(then[:, 4] - now[:, 4])))[known])
            now = then
    return {"features": np.concatenate(given), "kinds": np.concatenate(kinds)}


def _walkers(seed: int) -> list[MovingObstacle]:
    """Those of `PEOPLE` and `VEHICLES` who find room to cross the scene of a seed."""
    families, rng = list(Family), np.random.default_rng([seed, 1])
    scenario = generate(families[seed % len(families)], seed, observers=0)
    way = (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)
    ground = scenario.terrain.heightmap()
    return list(crossing_traffic(rng, ground, scenario.cover, way, people=PEOPLE, vehicles=VEHICLES))


def _motion(walkers: Sequence[MovingObstacle], times: np.ndarray) -> np.ndarray:
    """(n, 5) positions, velocities and headings of walkers at times (n,)."""
    poses = np.array([walker.pose_at(time) for walker, time in zip(walkers, times.tolist(), strict=True)])
    speeds = np.array([walker.patrol.speed if walker.patrol else 0.0 for walker in walkers])
    along = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    return np.column_stack([poses[:, :2], speeds[:, None] * along, poses[:, 2]])


def _sight(rng: np.random.Generator, walkers: int) -> np.ndarray:
    """(WATCHED, n) bool: when each is in sight, by turns of random length."""
    seen = np.zeros((WATCHED, walkers), bool)
    for column in seen.T:
        step, visible = 0, True
        while step < WATCHED:
            spell = round(float(rng.uniform(*(IN_SIGHT if visible else OUT_OF_SIGHT))) / STEP)
            column[step : step + spell] = visible
            step, visible = step + spell, not visible
    return seen


def _kinds(walks: Walks, change: np.ndarray) -> np.ndarray:
    place, before = walks.ahead()
    near, alike = AS_BEFORE
    again = (place <= walks.speed * STEP + near) & (np.abs(np.asarray(wrap_angle(change - before))) < alike)
    kinds = np.where(again, BINS, bin_of(change))
    return np.where(np.abs(change) > TURNED, kinds, -1).astype(np.int8)


def read(folder: Path, seeds: Sequence[int]) -> tuple[Tensor, Tensor]:
    """Features (n, FEATURES) and kinds (n,) of scenes that have been collected."""
    found = list(scene_samples.kept(folder, seeds, ("features", "kinds")))
    given = np.concatenate([arrays["features"] for arrays in found])
    kinds = np.concatenate([arrays["kinds"] for arrays in found]).astype(np.int64)
    return torch.from_numpy(given), torch.from_numpy(kinds)


def losses(network: HabitNetwork, given: Tensor, kinds: Tensor) -> tuple[Tensor, Tensor]:
    """Mean log-losses of whether there is a turn, and of which it is where there is."""
    odds, angles = network(given)
    turned = kinds >= 0
    turn = functional.binary_cross_entropy_with_logits(odds, turned.float())
    if not turned.any():
        return turn, turn.new_zeros(())
    return turn, functional.cross_entropy(angles[turned], kinds[turned])


def learn(folder: Path, lessons: Lessons) -> Iterator[tuple[Score, bool]]:
    """Train on what `collect` has put into `folder`: Adam, one cosine from 5e-3 to nothing; yields the
    validation's score after each epoch and whether it is the best so far, whose weights are in `WEIGHTS` and
    figures in `CARD`. Raises OSError, FileNotFoundError where a scene is missing."""
    torch.manual_seed(lessons.seed)
    network, rng = HabitNetwork(), np.random.default_rng(lessons.seed)
    (given, kinds), held_out = (read(folder, seeds) for seeds in lessons.seeds)
    usual = _usual(kinds, held_out[1])
    best = sum(usual)
    optimiser = torch.optim.Adam(network.parameters(), 5e-3)
    rounds = max(1, math.ceil(len(given) / BATCH))
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, lessons.epochs * rounds)
    for epoch in range(1, lessons.epochs + 1):
        for some in np.array_split(rng.permutation(len(given)), rounds):
            optimiser.zero_grad()
            turn, angle = losses(network, given[some], kinds[some])
            check_finite({"turn": turn.item(), "angle": angle.item()}, f"{epoch - 1} epochs")
            (turn + 0.1 * angle).backward()  # there are few turns, and each teaches as much as many steps
            optimiser.step()
            schedule.step()
        with torch.inference_mode():
            turn, angle = losses(network, *held_out)
        now = Score(float(turn), float(angle), *usual)
        better = now.total < best
        if better:
            best = now.total
            figures = {
                "lessons": asdict(lessons), "epoch": epoch, "steps": len(given),
                "validation_steps": len(held_out[0]), "validation": asdict(now),
            }  # fmt: skip
            save_habits(folder / WEIGHTS, network)
            write_file(folder / CARD, json.dumps(figures, indent=1).encode())
        yield now, better


def _usual(kinds: Tensor, held_out: Tensor) -> tuple[float, float]:
    """Log-losses on held-out kinds (m,) of guessing the shares among kinds (n,)."""
    share = ((kinds >= 0).float().mean()).clamp(1e-6, 1.0 - 1e-6)
    turned = (held_out >= 0).float()
    turn = -(turned * share.log() + (1.0 - turned) * (1.0 - share).log()).mean()
    count = torch.bincount(kinds[kinds >= 0], minlength=BINS + 1).float() + 1.0
    angle = -(count / count.sum()).log()[held_out[held_out >= 0]]
    return float(turn), float(angle.mean()) if len(angle) else 0.0
