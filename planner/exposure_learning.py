"""Teaches the exposure network: drives seeded scenes with the sensors on, and compares what the map says of
the robot's exposure with the truth.

Nothing is driven in physics: the robot is set down every `STEP` metres along the routes that it might take.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from planner.covert_route import CovertPlanner
from planner.exposure_network import ExposureNetwork, turned, window
from planner.frames import Percept, Perception
from planner.hull_exposure import hull_exposure
from planner.learning_errors import check_finite
from planner.no_route import NoRoute
from planner.perception import Perceiver
from planner.sensed_exposure import sensed_exposure
from planner.suites import Knowledge, Suite, suite_mission
from scenes.pose import Pose, Twist
from scenes.rays import RayScene
from scenes.scenario import Family, Scenario
from scenes.stance import standing_poses
from scenes.terrain import Heightmap

STEP, SPEED = 0.2, 0.85
KEPT = 9
"""One place in so many leaves a sample."""

ROUTE_WEIGHTS = (0.0, 0.5, 0.9)
"""Of exposure, for the routes that are driven; each scene has one of them."""


@dataclass(frozen=True)
class Sample:
    """What the network is given, layers (channels, 64, 64) float16; what is true, (64, 64) float16; and where
    it counts, (64, 64) bool: on ground that a robot may stand on."""

    layers: np.ndarray
    target: np.ndarray
    counts: np.ndarray


def samples(terrain: Family, seed: int, goal_distance: float = 12.0) -> list[Sample]:
    """A drive through the covert mission of a seed. Raises ScenarioError where the terrain gives none."""
    scenario = suite_mission(Suite.COVERT, terrain, seed, Knowledge.KNOWN, goal_distance).scenario
    heightmap = scenario.terrain.heightmap()
    rays = RayScene(heightmap, scenario.cover)
    true = hull_exposure(rays, heightmap, scenario.observers).anywhere
    rng = np.random.default_rng(seed)
    perceiver = Perceiver(scenario, Perception.LIDAR, rng)
    taken = []
    for index, (pose, time_s) in enumerate(_places(scenario, rays, float(rng.choice(ROUTE_WEIGHTS)))):
        rays.set_walkers(scenario.obstacles, scenario.observers, time_s)
        goal = (scenario.goal.x, scenario.goal.y)
        percept = perceiver.perceive(rays, pose, Twist(SPEED, 0.0), time_s, goal)
        if index % KEPT == 2:
            taken.append(_sample(percept, heightmap, true))
    return taken


def _places(scenario: Scenario, rays: RayScene, weight: float) -> Iterator[tuple[Pose, float]]:
    heightmap = scenario.terrain.heightmap()
    planner = CovertPlanner(heightmap, scenario.cover, scenario.observers, rays)
    start, goal = (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)
    try:
        points = planner.route(start, goal, weight, math.radians(scenario.start.yaw)).points
    except NoRoute:
        return
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    along = np.arange(0.0, lengths[-1], STEP)
    x, y = np.interp(along, lengths, points[:, 0]), np.interp(along, lengths, points[:, 1])
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    yield from zip(standing_poses(heightmap, x, y, yaw), (along / SPEED).tolist(), strict=True)


def _sample(percept: Percept, heightmap: Heightmap, true: np.ndarray) -> Sample:
    part = window(percept, sensed_exposure(percept))
    grid = percept.grid
    x, y = grid.x_min + part.cols * grid.resolution, grid.y_min + part.rows * grid.resolution
    west, east, south, north = heightmap.bounds
    inside = ((y >= south) & (y <= north))[:, None] & ((x >= west) & (x <= east))[None]
    target = true[heightmap.cells(*np.meshgrid(x, y))]
    free = ~grid.obstacle[np.ix_(part.rows, part.cols)]
    return Sample(part.layers.astype(np.float16), target.astype(np.float16), inside & free)


@dataclass(frozen=True)
class Score:
    """Means over cells that count, for the network and for the sensed exposure it begins with: absolute error
    and Brier score (Brier 1950) of the share seen."""

    error: float
    brier: float
    sensed_error: float
    sensed_brier: float

    @property
    def words(self) -> str:
        """For people."""
        return f"Brier {self.brier:.4f}, the map alone {self.sensed_brier:.4f}"


def fit(
    network: ExposureNetwork,
    given: Sequence[Sample],
    held_out: Sequence[Sample],
    epochs: int,
    seed: int,
    rate: float = 2e-3,
    batch: int = 32,
) -> Iterator[Score]:
    """Train for `epochs`, turning and mirroring the samples at random; yields the score on `held_out` after
    each. Adam, one cosine from `rate` to nothing, binary cross entropy against the true share."""
    rng = np.random.default_rng(seed)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload] # a third faster
    optimiser = torch.optim.Adam(network.parameters(), rate)
    rounds = -(-len(given) // batch)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, epochs * rounds)
    loss = nn.BCEWithLogitsLoss(reduction="none")
    for epoch in range(epochs):
        network.train()
        order = rng.permutation(len(given))
        for some in np.array_split(order, rounds):
            quarter, mirrored = int(rng.integers(4)), bool(rng.integers(2))
            stacked = _stacked([given[i] for i in some])
            layers, target, counts = (torch.from_numpy(turned(part, quarter, mirrored)) for part in stacked)
            optimiser.zero_grad()
            log_odds = network(layers.contiguous(memory_format=torch.channels_last))
            losses = loss(log_odds, target[:, 0]) * counts[:, 0]
            mean = losses.sum() / counts.sum()
            check_finite({"cross entropy": mean.item()}, f"{epoch} epochs")
            mean.backward()
            optimiser.step()
            schedule.step()
        yield score(network, held_out)


def score(network: ExposureNetwork, held_out: Sequence[Sample], batch: int = 32) -> Score:
    """How well the network does on samples it has not learnt from."""
    network.eval()
    sums, count = np.zeros(4), 0.0
    for begin in range(0, len(held_out), batch):
        layers, target, counts = _stacked(held_out[begin : begin + batch])
        with torch.inference_mode():
            chance = torch.sigmoid(network(torch.from_numpy(layers))).numpy()
        for place, guess in enumerate((chance, layers[:, 0])):
            miss = (guess - target[:, 0]) * counts[:, 0]
            sums[2 * place : 2 * place + 2] += np.abs(miss).sum(), np.square(miss).sum()
        count += counts.sum()
    return Score(*(sums / max(count, 1.0)).tolist())


def _stacked(some: Sequence[Sample]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.stack([sample.layers for sample in some]).astype(np.float32),
        np.stack([sample.target[None] for sample in some]).astype(np.float32),
        np.stack([sample.counts[None] for sample in some]).astype(np.float32),
    )
