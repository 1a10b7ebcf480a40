"""Moving obstacles as tracks: a disc with a constant velocity for each, from the returns on it.

Which returns belong to which moving thing is told by their labels, a stand-in for a segmenter of point
clouds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from planner.frames import TrackedObstacle
from scenes.scenario import OBSTACLE_SIZES, ObstacleKind

FORGET_AFTER = 1.0  # seconds
MIN_POINTS = 3
ACCELERATION_SIGMA = 1.0  # m/s²: how briskly people and vehicles change their velocity
FIRST_SPEED_SIGMA = 1.5
FACING_SPEED = 0.5  # m/s from which a track's velocity tells where a vehicle faces
POSITION_SIGMA = {ObstacleKind.PERSON: 0.08, ObstacleKind.VEHICLE: 0.4}


@dataclass(frozen=True)
class Sighted:
    """Where a moving obstacle seems to be in one scan."""

    object_id: int
    kind: ObstacleKind
    x: float
    y: float


def obstacle_radius(kind: ObstacleKind) -> float:
    """Of the disc that holds the outline, metres."""
    length, width, _ = OBSTACLE_SIZES[kind]
    return 0.5 * (length if kind is ObstacleKind.PERSON else math.hypot(length, width))


def locate(object_id: int, kind: ObstacleKind, points: np.ndarray, sensor: np.ndarray) -> Sighted | None:
    """The middle of what the points (n, 3) show of it from `sensor` (3,), metres in the world; None for
    fewer points than say anything. Only the near side is seen, so along the view it is taken to be at
    least as deep as its kind is wide."""
    if len(points) < MIN_POINTS:
        return None
    offset = points[:, :2] - sensor[:2]
    ahead = offset.mean(axis=0)
    ahead = ahead / max(float(np.hypot(*ahead)), 1e-6)
    along, across = offset @ ahead, offset @ (-ahead[1], ahead[0])
    near = along.min()
    depth = 0.5 * (near + max(along.max(), near + OBSTACLE_SIZES[kind][1]))
    aside = 0.5 * (across.min() + across.max())
    x, y = sensor[:2] + depth * ahead + aside * np.array([-ahead[1], ahead[0]])
    return Sighted(object_id, kind, float(x), float(y))


def outline_discs(obstacle: TrackedObstacle) -> list[tuple[float, float, float]]:
    """x, y and radius of discs that hold its outline: one for who is round or stands, and for a vehicle on
    its way three along it, for it faces where it goes."""
    speed = math.hypot(obstacle.vx, obstacle.vy)
    if obstacle.kind is not ObstacleKind.VEHICLE or speed < FACING_SPEED:
        return [(obstacle.x, obstacle.y, obstacle.radius)]
    length, width, _ = OBSTACLE_SIZES[obstacle.kind]
    third, radius = length / 3.0, math.hypot(length / 6.0, 0.5 * width)
    ahead_x, ahead_y = third * obstacle.vx / speed, third * obstacle.vy / speed
    return [(obstacle.x + k * ahead_x, obstacle.y + k * ahead_y, radius) for k in (-1, 0, 1)]


@dataclass(frozen=True)
class _Track:
    """A Kalman filter of constant velocity; the covariance (position, both, velocity) is the same for x
    and y."""

    obstacle: TrackedObstacle
    covariance: tuple[float, float, float]
    time_s: float
    seen_s: float

    def at(self, time_s: float) -> _Track:
        """Predicted to a later time."""
        dt, o = time_s - self.time_s, self.obstacle
        pp, pv, vv = self.covariance
        q = ACCELERATION_SIGMA**2
        covariance = (
            pp + 2.0 * dt * pv + dt * dt * vv + 0.25 * q * dt**4,
            pv + dt * vv + 0.5 * q * dt**3,
            vv + q * dt * dt,
        )
        moved = replace(o, x=o.x + dt * o.vx, y=o.y + dt * o.vy)
        return _Track(moved, covariance, time_s, self.seen_s)

    def corrected(self, sighted: Sighted) -> _Track:
        o, (pp, pv, vv) = self.obstacle, self.covariance
        total = pp + POSITION_SIGMA[o.kind] ** 2
        gain, gain_v = pp / total, pv / total
        dx, dy = sighted.x - o.x, sighted.y - o.y
        obstacle = replace(
            o, x=o.x + gain * dx, y=o.y + gain * dy, vx=o.vx + gain_v * dx, vy=o.vy + gain_v * dy
        )
        covariance = ((1.0 - gain) * pp, (1.0 - gain) * pv, vv - gain_v * pv)
        return _Track(obstacle, covariance, self.time_s, self.time_s)


class ObstacleTracker:
    """Tracks by object id; one that is not seen for a second is forgotten."""

    def __init__(self) -> None:
        self._tracks: dict[int, _Track] = {}

    def update(self, time_s: float, sighted: list[Sighted]) -> tuple[TrackedObstacle, ...]:
        """Predict all tracks to `time_s`, correct those that are sighted, and return them by id."""
        tracks = {key: track.at(time_s) for key, track in self._tracks.items()}
        for seen in sighted:
            track = tracks.get(seen.object_id)
            tracks[seen.object_id] = _begin(seen, time_s) if track is None else track.corrected(seen)
        self._tracks = {k: t for k, t in sorted(tracks.items()) if time_s - t.seen_s <= FORGET_AFTER}
        return tuple(track.obstacle for track in self._tracks.values())


def _begin(seen: Sighted, time_s: float) -> _Track:
    obstacle = TrackedObstacle(
        seen.object_id, seen.kind, seen.x, seen.y, 0.0, 0.0, obstacle_radius(seen.kind)
    )
    variance = POSITION_SIGMA[seen.kind] ** 2
    return _Track(obstacle, (variance, 0.0, FIRST_SPEED_SIGMA**2), time_s, time_s)
