"""Posting watchers: by luck or where a watcher would stand, and such as matter, who see the shortest way
while another way is there that they hardly see.

Candidates are judged over a lattice of coarse cells about start and goal, where one ray a cell and candidate
is cheap and a search takes less than a millisecond.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from planner.covert_kernel import search
from planner.covert_route import LONGEST, CovertPlanner
from planner.line_of_sight import views_at
from scenes.placement import room_to_watch, watcher
from scenes.robot import HUSKY
from scenes.scenario import Observer

MOST_WATCHERS = 3
CANDIDATES, GROUPS = 24, 40
LATTICE = 0.75
HIDDEN_METRE = 0.1  # cost of a metre that nobody sees, beside 1 for one in full view


POOL = 8
"""Places looked at for each candidate."""

LANE = 5.0  # metres to either side of the straight way that a watcher wants to see
SIGHT, CLIMB, BACKING = 3.0, 0.5, 0.5
"""Of a place's odds: power of the share of the lane in view, and exponents for a standard deviation of height
and for cover at its back."""

BACKED = 3.0  # metres from cover that serves a watcher


class Placement(StrEnum):
    """uniform : anywhere that has room to stand
    vantage : as a watcher would choose, by a view of the way between start and goal, height and cover of
        its own
    """

    UNIFORM = "uniform"
    VANTAGE = "vantage"


@dataclass(frozen=True, eq=False)
class _Lattice:
    """points : (rows, cols, 2); open : (rows, cols) bool, drivable and of use; begin, end : flat indices"""

    points: np.ndarray
    open: np.ndarray
    spacing: float
    begin: int
    end: int


def watching_groups(
    rng: np.random.Generator,
    planner: CovertPlanner,
    start: tuple[float, float],
    goal: tuple[float, float],
    least_seen: float,
    most_left: float,
    placement: Placement = Placement.UNIFORM,
) -> Iterator[tuple[Observer, ...]]:
    """Groups of one to three watchers, all of one size, in no order, who see at least `least_seen` of the
    shortest way, and at most `most_left` of that on another. A guess: the caller checks.

    planner : of the map without observers. Raises planner.covert_route.NoRoute.
    """
    shortest = planner.route(start, goal, 0.0).points
    places = posts(rng, planner, start, goal, CANDIDATES, placement)
    middle = 0.5 * (np.array(start) + goal)
    candidates = [watcher(rng, 1, place, middle) for place in places]
    lattice = _lattice(planner, start, goal)
    light = np.ones((len(candidates), *lattice.open.shape))
    light[:, lattice.open] = _light(planner, candidates, lattice.points[lattice.open])
    on_shortest = _light(planner, candidates, _evenly(shortest))
    size = int(rng.integers(1, MOST_WATCHERS + 1))
    for _ in range(GROUPS if len(candidates) >= size else 0):
        group = rng.choice(len(candidates), size, replace=False)
        seen = float(on_shortest[group].max(axis=0).mean())
        length = float(np.hypot(*np.diff(shortest, axis=0).T).sum())
        if seen >= least_seen and _least_seen(lattice, light[group].max(axis=0)) <= most_left * seen * length:
            yield tuple(
                candidates[member].model_copy(update={"id": number}) for number, member in enumerate(group, 1)
            )


def posts(
    rng: np.random.Generator,
    planner: CovertPlanner,
    start: tuple[float, float],
    goal: tuple[float, float],
    count: int,
    placement: Placement,
) -> np.ndarray:
    """(n, 2) places for watchers of the way from start to goal, at most `count`, in the order drawn."""
    ground = planner.heightmap
    half = ground.bounds[1] - 1.0
    places = rng.uniform(-half, half, (POOL * count, 2))
    places = places[room_to_watch(ground, planner.cover, (start, goal), places)]
    if placement is Placement.VANTAGE and len(places):
        odds = _odds(planner, places, start, goal)
        some = min(count, int(np.count_nonzero(odds)))
        places = places[rng.choice(len(places), some, replace=False, p=odds)]
    return places[:count]


def post_watchers(
    rng: np.random.Generator,
    planner: CovertPlanner,
    start: tuple[float, float],
    goal: tuple[float, float],
    count: int,
    placement: Placement,
) -> tuple[Observer, ...]:
    """At most `count` watchers, who face the middle of the way more or less."""
    middle = 0.5 * (np.array(start) + goal)
    places = posts(rng, planner, start, goal, max(count, 1), placement)[:count]
    return tuple(watcher(rng, number, place, middle) for number, place in enumerate(places, 1))


def _odds(
    planner: CovertPlanner, places: np.ndarray, start: tuple[float, float], goal: tuple[float, float]
) -> np.ndarray:
    """(n,) chances that a watcher takes each of the places (n, 2), above all by its view of the lane."""
    ground = planner.heightmap
    lane = points_about((start, goal), 2.0, LANE)
    lane = lane[np.array([ground.contains(x, y) for x, y in lane.tolist()])]
    watchers = [
        Observer(id=number, x=x, y=y, yaw=0.0, fov_horizontal=360.0, range=60.0)
        for number, (x, y) in enumerate(places.tolist(), 1)
    ]
    share = _light(planner, watchers, lane).mean(axis=1)
    height = ground.height_at(*places.T)
    above = np.clip((height - ground.heights.mean()) / (ground.heights.std() + 0.2), -2.0, 2.0)
    room = np.minimum.reduce(
        [thing.footprint.distance(places) for thing in planner.cover] or [np.full(len(places), np.inf)]
    )
    odds = share**SIGHT * np.exp(CLIMB * above + BACKING * (room < BACKED))
    return odds / odds.sum() if odds.sum() > 0.0 else np.full(len(places), 1.0 / len(places))


def points_about(
    route: tuple[tuple[float, float], tuple[float, float]], spacing: float, width: float
) -> np.ndarray:
    """(n, 2) points of a lattice along the straight line and up to `width` to either side of it, metres."""
    start, goal = (np.array(end, float) for end in route)
    length = max(float(np.hypot(*(goal - start))), spacing)
    ahead = (goal - start) / length
    along = np.linspace(0.0, length, max(2, round(length / spacing) + 1))
    aside = np.linspace(-width, width, max(2, round(2.0 * width / spacing) + 1))
    u, v = (axis.ravel() for axis in np.meshgrid(along, aside))
    return start + u[:, None] * ahead + v[:, None] * np.array([-ahead[1], ahead[0]])


def _lattice(planner: CovertPlanner, start: tuple[float, float], goal: tuple[float, float]) -> _Lattice:
    costs = planner.costs
    step = max(1, round(LATTICE / costs.resolution))
    pick = (slice(None, None, step),) * 2
    row, col = np.indices(costs.forbidden.shape)[:, ::step, ::step]
    points = costs.centre(row, col)
    by_way = sum(np.hypot(points[..., 0] - x, points[..., 1] - y) for x, y in (start, goal))
    use = ~costs.forbidden[pick] & (by_way <= 0.9 * LONGEST * math.dist(start, goal))
    ends = []
    for end in (start, goal):
        index = int(np.argmin(np.hypot(points[..., 0] - end[0], points[..., 1] - end[1])))
        use.flat[index] = True
        ends.append(index)
    return _Lattice(points, use, step * costs.resolution, *ends)


def _least_seen(lattice: _Lattice, light: np.ndarray) -> float:
    """Metres in view on the way that a robot shy of view takes over the lattice, inf where there is none."""
    cost = np.where(lattice.open, HIDDEN_METRE + light, np.inf)
    parent, best = search(np.repeat(cost[None], 4, axis=0), lattice.spacing, lattice.begin, lattice.end)
    if not math.isfinite(best[lattice.end]):
        return math.inf
    seen, at = 0.0, lattice.end
    points, light = lattice.points.reshape(-1, 2), light.ravel()
    while at != lattice.begin:
        before = int(parent[at])
        seen += 0.5 * (light[at] + light[before]) * math.dist(points[at], points[before])
        at = before
    return seen


def _light(planner: CovertPlanner, candidates: list[Observer], points: np.ndarray) -> np.ndarray:
    """(candidates, n) share of light from the middle height of a robot at points (n, 2)."""
    ground = planner.heightmap
    raised = np.column_stack([points, ground.height_at(*points.T) + 0.5 * HUSKY.height])
    light = np.zeros((len(candidates), len(points)))
    for row, view in zip(light, views_at(candidates, ground, 0.0), strict=True):
        held = view.holds(raised)
        row[held] = planner.rays.visible(view.eye, raised[held])
    return light


def _evenly(points: np.ndarray) -> np.ndarray:
    """(40, 2) places along a polyline (k, 2)."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], 40)
    return np.column_stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)])
