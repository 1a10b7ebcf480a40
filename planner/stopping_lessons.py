"""Teaches how far the Husky rolls on: stops at random on generated terrain in full physics, and the quantiles
of what they took."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from planner import scene_samples
from planner.checkpoint import write_file
from planner.scene_samples import Lessons
from planner.stopping import FEATURES, GENTLE, QUANTILES, StoppingNetwork, features, save_stopping
from scenes.families import generate
from scenes.physics import RobotLostError, World
from scenes.pose import Twist
from scenes.robot import HUSKY
from scenes.scenario import Family

WEIGHTS, CARD = "covernav.safetensors", "covernav.json"

USUAL = Lessons(scenes=48, held_out=16, seed=5000, epochs=300)

STOPS = 40
"""In a scene."""

RUN_UP, STEP, LONGEST = 1.2, 0.1, 2.0  # seconds
STANDING = 0.05  # m/s
EDGE = 3.0  # metres from the border of the map in which no stop begins


@dataclass(frozen=True)
class Score:
    """pinball : mean loss over `QUANTILES` in metres (Koenker and Bassett 1978); covered : share of stops
    that were no longer than each of them; error : mean distance of the first from the truth, metres; and the
    same of braking at `GENTLE` m/s²"""

    pinball: float
    covered: tuple[float, ...]
    error: float
    gentle_pinball: float
    gentle_error: float

    @property
    def words(self) -> str:
        """For people."""
        shares = " and ".join(f"{100.0 * share:.0f}" for share in self.covered)
        return f"foreseen within {1e3 * self.error:.1f} mm on the mean, {shares} % of stops covered"


def collect(folder: Path, seeds: Sequence[int], jobs: int) -> Iterator[int]:
    """Stop in the scenes that are not in `folder` yet; yields each seed as it is there. Raises OSError."""
    return scene_samples.collect(folder, seeds, jobs, stops)


def stops(seed: int) -> dict[str, np.ndarray]:
    """features : (n, 4) float32 when told to stop; ways : (n,) float32 metres rolled on along the heading."""
    families = list(Family)
    scenario = generate(families[seed % len(families)], seed)
    heightmap, rng = scenario.terrain.heightmap(), np.random.default_rng(seed)
    west, east, south, north = heightmap.bounds
    given, ways = [], []
    with World(heightmap, start=scenario.start) as world:
        for _ in range(STOPS):
            x, y = rng.uniform((west + EDGE, south + EDGE), (east - EDGE, north - EDGE))
            yaw = rng.uniform(-math.pi, math.pi)
            turning = rng.uniform(-1.0, 1.0) if rng.random() < 0.5 else 0.0
            command = Twist(rng.uniform(0.15, HUSKY.max_speed), turning)
            try:
                world.place_robot(x, y, yaw)
                stop = _stop(world, command)
            except RobotLostError:
                continue
            if stop is not None:
                given.append(stop[0])
                ways.append(stop[1])
    return {
        "features": np.array(given, np.float32).reshape(-1, len(FEATURES)),
        "ways": np.array(ways, np.float32),
    }


def _stop(world: World, command: Twist) -> tuple[np.ndarray, float] | None:
    """Features and way of one stop; None where the ground was too steep to drive on or let it not move."""
    for _ in range(round(RUN_UP / STEP)):
        world.step(command, STEP)
    begin, twist = world.pose, world.twist
    if max(abs(begin.pitch), abs(begin.roll)) > HUSKY.max_slope or twist.v < 0.1:
        return None
    begun_s = world.time_s
    while abs(world.twist.v) > STANDING and world.time_s - begun_s < LONGEST:
        world.step(Twist(), STEP)
    along = (world.pose.x - begin.x) * math.cos(begin.yaw) + (world.pose.y - begin.y) * math.sin(begin.yaw)
    return features(begin, twist), max(along, 0.0)


def read(folder: Path, seeds: Sequence[int]) -> tuple[torch.Tensor, torch.Tensor]:
    """Features (n, 4) and ways (n, 1) of scenes that have been collected."""
    found = list(scene_samples.kept(folder, seeds))
    given = np.concatenate([arrays["features"] for arrays in found])
    ways = np.concatenate([arrays["ways"] for arrays in found])
    return torch.from_numpy(given), torch.from_numpy(ways)[:, None]


def pinball(guess: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """(n, q) losses of guesses (n, q) of the quantiles of what is true (n, 1)."""
    level, short = torch.tensor(QUANTILES), true - guess
    return torch.maximum(level * short, (level - 1.0) * short)


def score(network: StoppingNetwork, given: torch.Tensor, ways: torch.Tensor) -> Score:
    """How well it foresees stops."""
    with torch.inference_mode():
        guess, gentle = network(given), (given[:, :1] ** 2 / (2.0 * GENTLE)).expand(-1, len(QUANTILES))
        covered = (ways <= guess).float().mean(0)
        return Score(
            float(pinball(guess, ways).mean()), tuple(round(share, 3) for share in covered.tolist()),
            float((guess[:, :1] - ways).abs().mean()), float(pinball(gentle, ways).mean()),
            float((gentle[:, :1] - ways).abs().mean()),
        )  # fmt: skip


def learn(folder: Path, lessons: Lessons) -> Iterator[tuple[Score, bool]]:
    """Train on what `collect` has put into `folder`: Adam over all stops at once; yields the validation's
    score after each epoch and whether it is the best so far, whose weights are in `WEIGHTS` and figures in
    `CARD`. Raises OSError, FileNotFoundError where a scene is missing."""
    torch.manual_seed(lessons.seed)
    network = StoppingNetwork()
    given, held_out = (read(folder, seeds) for seeds in lessons.seeds)
    optimiser = torch.optim.Adam(network.parameters(), 1e-2)
    best = score(network, *held_out)
    for epoch in range(1, lessons.epochs + 1):
        optimiser.zero_grad()
        pinball(network(given[0]), given[1]).mean().backward()
        optimiser.step()
        now = score(network, *held_out)
        better = now.pinball < best.pinball
        if better:
            best = now
            figures = {
                "lessons": asdict(lessons), "epoch": epoch, "stops": len(given[0]),
                "validation_stops": len(held_out[0]), "validation": asdict(now),
            }  # fmt: skip
            save_stopping(folder / WEIGHTS, network)
            write_file(folder / CARD, json.dumps(figures, indent=1).encode())
        yield now, better
