"""Where those who walk or drive about will be, as far as can be told from what was seen of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

import numpy as np

from planner.frames import TrackedObstacle

Track = np.ndarray
"""(k, 5) sightings of one moving obstacle, oldest first: seconds, world x and y, and their rates a second."""

BETWEEN = 0.5
"""Seconds between the sightings that are remembered; the newest one is, whenever it was."""

REMEMBERED = 120
"""Sightings of each obstacle."""


class Foresight(Protocol):
    """Tells where a moving obstacle goes on to."""

    def __call__(self, obstacle: TrackedObstacle, track: Track, times: Sequence[float]) -> np.ndarray:
        """(times, n, 3) world x and y in metres and heading in radians on n ways that are evenly likely.

        track : of the obstacle, one sighting at least; times : seconds of the mission's clock, ascending,
        none before the track's end"""
        ...


def straight_on(obstacle: TrackedObstacle, track: Track, times: Sequence[float]) -> np.ndarray:
    """At its present velocity for ever (Seder and Petrović 2007)."""
    ahead = np.array(times)[:, None] - track[-1, 0]
    place = np.array([obstacle.x, obstacle.y]) + ahead * (obstacle.vx, obstacle.vy)
    heading = np.full(len(place), np.arctan2(obstacle.vy, obstacle.vx))
    return np.column_stack([place, heading])[:, None]


class TrackLog:
    """Remembers where each moving obstacle has been, long after it was out of sight."""

    def __init__(self) -> None:
        self._tracks: dict[int, deque[tuple[float, ...]]] = {}

    def see(self, time_s: float, obstacles: Iterable[TrackedObstacle]) -> None:
        """Add where they are now."""
        for one in obstacles:
            track = self._tracks.setdefault(one.object_id, deque(maxlen=REMEMBERED))
            while track and track[-1][0] >= time_s:  # the same moment, or the clock was set back
                track.pop()
            if len(track) > 1 and time_s - track[-2][0] <= BETWEEN + 1e-6:
                track.pop()
            track.append((time_s, one.x, one.y, one.vx, one.vy))

    def tracks(self, obstacles: Iterable[TrackedObstacle]) -> Mapping[int, Track]:
        """Of these obstacles, by their ids."""
        return {one.object_id: np.array(self._tracks[one.object_id]) for one in obstacles}
