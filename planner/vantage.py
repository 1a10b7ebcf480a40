"""Where a watcher should stand to see a route, and where the robot can hide next."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.covert_kernel import search
from planner.covert_route import CovertPlanner, CovertRoute
from planner.line_of_sight import View
from planner.no_route import NoRoute
from scenes.catalogue import Footprint
from scenes.robot import HUSKY
from scenes.terrain import Quality, Surface

EYE_HEIGHT, RANGE = 1.7, 60.0
SPACING = 1.5  # metres between places that are tried
PLACES = 80  # along the route
ROOM = 0.6  # metres from cover
HIDDEN = 0.05
"""Visible fraction up to which the robot counts as hidden."""


@dataclass(frozen=True)
class Vantage:
    """A watcher's place, in metres and radians, facing the middle of what it sees.

    seen : share of the route in view from here alone; adds : share that those before it do not see
    """

    x: float
    y: float
    yaw: float
    seen: float
    adds: float


def best_vantages(planner: CovertPlanner, points: np.ndarray, count: int = 3) -> tuple[Vantage, ...]:
    """The places from which watchers who look all round see most of a route (k, 2) together, each chosen
    with those before it in mind: greedy, so that k of them see at least 63 % of what the best k would.

    Fewer than `count` where more would add nothing. Raises ValueError for a count below 1.
    """
    if count < 1:
        raise ValueError(f"at least one watcher is needed, got {count}")
    places = _standing_room(planner)
    targets = _along(planner, points)
    light = np.stack([_seen_from(planner, place, targets) for place in places])
    covered = np.zeros(len(targets))
    chosen: list[Vantage] = []
    while len(chosen) < count and len(places):
        gain = np.maximum(light - covered, 0.0).mean(axis=1)
        best = int(np.argmax(gain))
        if gain[best] < 1e-6:
            break
        middle = np.average(targets[:, :2], axis=0, weights=light[best])
        x, y = (float(value) for value in places[best])
        yaw = math.atan2(middle[1] - y, middle[0] - x)
        chosen.append(Vantage(x, y, yaw, float(light[best].mean()), float(gain[best])))
        covered = np.maximum(covered, light[best])
    return tuple(chosen)


def nearest_hiding_place(
    planner: CovertPlanner, start: tuple[float, float], yaw: float | None = None
) -> CovertRoute:
    """The quickest way from `start` (world x, y) to where at most a twentieth of the robot is seen, however
    it heads; over the patrols' mean exposure, where there are any.

    Raises NoRoute where there is no such place."""
    if not planner.grid.contains(*start):
        raise NoRoute(f"({start[0]:g}, {start[1]:g}) is off the map", start)
    costs = planner.costs
    begin = int(np.ravel_multi_index(costs.cell(*start), costs.forbidden.shape))
    seconds = 1.0 / planner.config.pace.speed(planner.clearance)
    seconds = seconds + planner.config.treacherous * planner.treacherous
    seconds[:, costs.forbidden] = np.inf
    if costs.forbidden.flat[begin]:
        seconds[:, *np.unravel_index(begin, costs.forbidden.shape)] = 1.0 / planner.config.pace.slow
    _, best = search(seconds, costs.resolution, begin, -1)
    hidden = (planner.exposure.fraction.max(axis=0) <= HIDDEN).ravel()
    best = np.where(hidden, best, np.inf)
    nearest = int(np.argmin(best))
    if not math.isfinite(best[nearest]):
        raise NoRoute("no place that the robot can reach is hidden from every observer", start)
    x, y = (float(value) for value in costs.centre(*np.unravel_index(nearest, costs.forbidden.shape)))
    if nearest == begin:
        x, y = start
    return planner.route(start, (x, y), 0.0, yaw)


def _standing_room(planner: CovertPlanner) -> np.ndarray:
    """(n, 2) places about `SPACING` apart where somebody can stand: dry, known ground, clear of cover."""
    ground = planner.heightmap
    step = max(1, round(SPACING / ground.resolution))
    x, y = (axis[::step, ::step].ravel() for axis in ground.xy())
    free = np.array(
        [
            ground.surface_at(*place) is not Surface.WATER
            and ground.quality_at(*place) is not Quality.MISSING
            for place in zip(x, y, strict=True)
        ]
    )
    places = np.column_stack([x, y])[free]
    for thing in planner.cover:
        places = places[_clear(thing.footprint, places)]
    return places


def _clear(outline: Footprint, places: np.ndarray) -> np.ndarray:
    near = np.hypot(places[:, 0] - outline.x, places[:, 1] - outline.y) < outline.radius + ROOM
    clear = ~near
    if near.any():
        clear[near] = outline.distance(places[near]) >= ROOM
    return clear


def _along(planner: CovertPlanner, points: np.ndarray) -> np.ndarray:
    """(n, 3) the robot's middle height at places evenly along a polyline (k, 2)."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], PLACES)
    x, y = (np.interp(at, along, points[:, axis]) for axis in (0, 1))
    return np.column_stack([x, y, planner.heightmap.height_at(x, y) + 0.5 * HUSKY.height])


def _seen_from(planner: CovertPlanner, place: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(n,) share of light from the targets (n, 3) to a watcher at a place (2,) who looks all round."""
    x, y = (float(value) for value in place)
    eye = View(
        0, x, y, float(planner.heightmap.height_at(x, y)) + EYE_HEIGHT, 0.0, 2.0 * math.pi, math.pi, RANGE
    )
    light = np.zeros(len(targets))
    held = eye.holds(targets)
    light[held] = planner.rays.visible(eye.eye, targets[held])
    return light
