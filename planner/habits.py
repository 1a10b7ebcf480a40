"""How people and vehicles go on, learnt from their habits: when one turns, and which way.

A small network tells from what a robot remembers of a walk (`planner.walks`) the chance that the walker turns
within the next `STEP`, and by how much. Walks are let go on by it as several that are evenly likely, so that
a beat seen once round is known, and one that was only begun is as sure as beats are alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from planner.checkpoint import PolicyError, PolicyName, load_weights, read_tensors, weights, write_tensors
from planner.foresight import Track, straight_on
from planner.frames import TrackedObstacle
from planner.walks import FEATURES, STEP, Walks
from scenes.scenario import ObstacleKind

ARCHITECTURE = "habit_mlp"
BINS = 8
"""Of a turn's angle, evenly from half a turn to the right on; one more means as it turned there before."""

WIDTH = 48
WAYS = 8
"""On which a walk is let go on."""

TURNS_DRAWN = 16
"""Of each way; then the draws are the first ones again."""

LONGEST_AHEAD = 20.0
"""Seconds since a sighting after which the walker is thought to be where it would be then."""


class HabitNetwork(nn.Module):
    """`FEATURES` (n, 13) to log-odds: (n,) of a turn within `STEP`, (n, BINS + 1) of its angle."""

    def __init__(self) -> None:
        super().__init__()
        self.hidden = nn.Sequential(
            nn.Linear(len(FEATURES), WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh()
        )
        self.last = nn.Linear(WIDTH, 2 + BINS)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(self, given: Tensor) -> tuple[Tensor, Tensor]:
        out = self.last(self.hidden(given))
        return out[:, 0], out[:, 1:]


def bin_of(turn: np.ndarray) -> np.ndarray:
    """(n,) which of `BINS` holds each angle (n,), radians."""
    return np.rint((turn + math.pi) / (2.0 * math.pi / BINS)).astype(int) % BINS


def angle_of(index: np.ndarray) -> np.ndarray:
    """(n,) radians in the middle of bins (n,)."""
    return -math.pi + (2.0 * math.pi / BINS) * index


class LearnedHabits:
    """A foresight (`planner.foresight`) by what a network has learnt. It remembers the tracks that it was
    asked about; what it says depends on its arguments alone."""

    def __init__(self, network: HabitNetwork):
        self._network = network.eval()
        self._known: dict[int, tuple[float, float, Walks]] = {}

    def __call__(self, obstacle: TrackedObstacle, track: Track, times: Sequence[float]) -> np.ndarray:
        """Its walk goes on in `WAYS` ways, straight on while nobody has seen it go anywhere."""
        walk = self._remembered(obstacle, track)
        if not walk.speed[0] > 0.0:
            return straight_on(obstacle, track, times)
        walk.position[0], walk.time[0] = track[-1, 1:3], track[-1, 0]
        walks = walk.repeated(WAYS)
        rng = np.random.default_rng(obstacle.object_id)  # the same luck in every plan, or plans would waver
        odds = np.stack([rng.permutation((np.arange(WAYS) + 0.5) / WAYS) for _ in range(TURNS_DRAWN)])
        turns = _Turns(-np.log(odds), odds[:, ::-1])
        begun_s = float(track[-1, 0])
        poses = np.empty((len(times), WAYS, 3))
        for index, time in enumerate(times):
            until = begun_s + min(time - begun_s, LONGEST_AHEAD)
            while until - walks.time[0] > 1e-6:
                seconds = min(STEP, until - float(walks.time[0]))
                walks.go(seconds, self._turn(walks, seconds, turns))
            poses[index, :, :2], poses[index, :, 2] = walks.position, walks.heading
        return poses

    def _remembered(self, obstacle: TrackedObstacle, track: Track) -> Walks:
        """One walk as its sightings tell."""
        begun_s, until_s, walk = self._known.get(obstacle.object_id, (math.nan, -math.inf, None))
        if walk is None or begun_s != track[0, 0] or until_s not in track[:-1, 0]:
            walk, until_s = Walks.unseen(np.array([obstacle.kind is ObstacleKind.VEHICLE])), -math.inf
        for sighting in track[:-1][track[:-1, 0] > until_s]:
            _see(walk, sighting)
            # The newest may yet be replaced by a newer one.
            self._known[obstacle.object_id] = float(track[0, 0]), float(sighting[0]), walk
        newest = walk.repeated(1)
        _see(newest, track[-1])
        return newest

    def _turn(self, walks: Walks, seconds: float, turns: _Turns) -> np.ndarray:
        """(n,) radians by which each way turns at the end of a step, NaN for not."""
        with torch.inference_mode():
            odds, kinds = self._network(torch.from_numpy(walks.features()))
        now = turns.due(nn.functional.softplus(odds).numpy() * (seconds / STEP))
        turn = np.full(len(now), np.nan)
        if now.any():
            place, before = walks.ahead()
            never = torch.from_numpy(np.isinf(place))[:, None] & (torch.arange(BINS + 1) == BINS)
            chance = torch.softmax(kinds.double().masked_fill(never, -torch.inf), 1).numpy().cumsum(axis=1)
            kind = (chance < turns.drawn()[:, None]).sum(axis=1).clip(max=BINS)
            angle = np.where(kind == BINS, before, angle_of(np.minimum(kind, BINS - 1)))
            turn[now] = angle[now]
            turns.count(now)
        return turn


def _see(walk: Walks, sighting: np.ndarray) -> None:
    walk.see(sighting[:1], sighting[None, 1:3], sighting[None, 3:], np.ones(1, bool))


class _Turns:
    """When each of n ways turns, and which way: by exponential and uniform variates (turns, n) that are
    handed in, so that all ways together are as the network's chances."""

    def __init__(self, waits: np.ndarray, odds: np.ndarray):
        self._waits, self._odds = waits, odds
        self._turned = np.zeros(waits.shape[1], int)
        self._left = waits[0].copy()

    def due(self, hazard: np.ndarray) -> np.ndarray:
        """(n,) bool: which turn in a step of hazards (n,)."""
        self._left -= hazard
        return self._left <= 0.0

    def drawn(self) -> np.ndarray:
        """(n,) uniform variates of their present turns."""
        return self._odds[self._turned % len(self._odds), np.arange(len(self._turned))]

    def count(self, now: np.ndarray) -> None:
        """Have those (n,) bool turned."""
        self._turned[now] += 1
        following = self._waits[self._turned % len(self._waits), np.arange(len(self._turned))]
        self._left[now] = following[now]


def save_habits(path: Path, network: HabitNetwork) -> PolicyName:
    """Write the network's weights. Raises OSError."""
    return PolicyName(path.stem, write_tensors(path, weights(network), {"architecture": ARCHITECTURE}))


def load_habits(path: Path) -> tuple[LearnedHabits, PolicyName]:
    """What a file has learnt. Raises PolicyError where it is truncated, not safetensors, of another
    architecture, or holds numbers that are not finite."""
    tensors, about, sha256 = read_tensors(path)
    if about.get("architecture") != ARCHITECTURE:
        kind = about.get("architecture", "none that it names")
        raise PolicyError(f"{path} holds weights of the architecture {kind}, not {ARCHITECTURE!r}")
    network = HabitNetwork()
    load_weights(network, tensors, path)
    return LearnedHabits(network), PolicyName(path.stem, sha256)
