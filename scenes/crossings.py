"""People and vehicles whose beats cross the straight way from start to goal.

Each goes to and fro along a straight beat that is clear of cover, water and both ends of the way, and is
where it crosses the way when a robot at its usual pace comes by, give or take a moment.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from scenes.families import generate
from scenes.placement import Segment, distance_to_segment
from scenes.scenario import (
    CoverObject,
    Family,
    MovingObstacle,
    ObstacleKind,
    Patrol,
    Point,
    Scenario,
    ScenarioError,
)
from scenes.terrain import SURFACE_CODE, Heightmap, Surface

PACE, STARTING_S = 0.85, 0.8
"""Metres a second of the robot that they are timed for, and what it takes to get going."""

LATENESS = 1.5
"""Seconds by which one may be early or late at the crossing."""

TRIES, ATTEMPTS = 100, 20
STRIDE = 0.25  # metres between the places of a beat that are looked at


@dataclass(frozen=True)
class Walk:
    """How one kind walks: m/s from and to; metres its beat keeps from cover, and from start and goal; and
    least and most metres of the beat on either side of the way."""

    speed: tuple[float, float]
    room: float
    ends: float
    reach: tuple[float, float]


WALKS = {
    ObstacleKind.PERSON: Walk((0.6, 1.5), 0.5, 2.0, (3.0, 10.0)),
    ObstacleKind.VEHICLE: Walk((1.5, 3.5), 1.2, 3.2, (5.0, 20.0)),
}


def crossing_traffic(
    rng: np.random.Generator,
    ground: Heightmap,
    cover: Iterable[CoverObject],
    way: Segment,
    people: int,
    vehicles: int,
) -> tuple[MovingObstacle, ...]:
    """So many of both at most, fewer where there is no room for their beats; numbered from 1.

    way : start and goal, (x, y) metres each
    """
    cover = tuple(cover)
    kinds = [ObstacleKind.VEHICLE] * vehicles + [ObstacleKind.PERSON] * people
    found: list[MovingObstacle] = []
    for kind in kinds:
        walker = _walker(rng, len(found) + 1, kind, ground, cover, way)
        if walker is not None:
            found.append(walker)
    return tuple(found)


def crossing_scenario(
    family: Family | str, seed: int, *, size_m: float = 48.0, goal_distance: float = 12.0, observers: int = 1
) -> Scenario:
    """Generated ground with one to three people and at most one vehicle that cross the way; the same
    arguments give the same document.

    Raises ScenarioError where an argument is out of range, or nobody finds room to cross.
    """
    scenario = generate(family, seed, size_m=size_m, goal_distance=goal_distance, observers=observers)
    rng = np.random.default_rng([seed, list(Family).index(Family(family)), 31])
    for _ in range(ATTEMPTS):
        start, goal = scenario.start, scenario.goal
        traffic = crossing_traffic(
            rng, scenario.terrain.heightmap(), scenario.cover, ((start.x, start.y), (goal.x, goal.y)),
            people=int(rng.integers(1, 4)), vehicles=int(rng.integers(0, 2)),
        )  # fmt: skip
        if traffic:
            about = "Generated ground with people or vehicles that cross the way"
            name = f"crossing {Family(family).value} {seed}"
            return scenario.revised(name=name, description=f"{about}, seed {seed}.", obstacles=traffic)
        land = int(rng.integers(2**31))
        scenario = generate(family, land, size_m=size_m, goal_distance=goal_distance, observers=observers)
    raise ScenarioError(f"nobody finds room to cross the way on ground of seed {seed}; take another seed")


def _walker(
    rng: np.random.Generator,
    number: int,
    kind: ObstacleKind,
    ground: Heightmap,
    cover: tuple[CoverObject, ...],
    way: Segment,
) -> MovingObstacle | None:
    start, along = np.array(way[0]), np.subtract(way[1], way[0])
    length, walk = float(np.hypot(*along)), WALKS[kind]
    for _ in range(TRIES):
        share, lateness = rng.uniform(0.2, 0.85), rng.uniform(-LATENESS, LATENESS)
        turn = math.radians(rng.uniform(50.0, 130.0)) * (1.0 if rng.random() < 0.5 else -1.0)
        speed, longest = round(float(rng.uniform(*walk.speed)), 2), rng.uniform(*walk.reach)
        cos, sin = math.cos(turn), math.sin(turn)
        heading = np.array([cos * along[0] - sin * along[1], sin * along[0] + cos * along[1]]) / length
        crossing = start + share * along
        before, beyond = (
            _free(ground, cover, way, walk, crossing, side * heading, longest) for side in (-1.0, 1.0)
        )
        if min(before, beyond) < walk.reach[0]:
            continue
        when = STARTING_S + share * length / PACE + lateness
        return _to_and_fro(number, kind, crossing, heading, (before, beyond), speed, max(when, 0.0))
    return None


def _free(
    ground: Heightmap,
    cover: tuple[CoverObject, ...],
    way: Segment,
    walk: Walk,
    crossing: np.ndarray,
    heading: np.ndarray,
    longest: float,
) -> float:
    """Metres from the crossing along a heading (2,) that are clear of everything, `longest` at most."""
    places = crossing + STRIDE * np.arange(int(longest / STRIDE) + 1)[:, None] * heading
    west, east, south, north = ground.bounds
    x, y = places.T
    free = (x > west + 1.0) & (x < east - 1.0) & (y > south + 1.0) & (y < north - 1.0)
    free &= np.min([np.hypot(*(places - end).T) for end in np.array(way)], axis=0) > walk.ends
    inside = np.flatnonzero(free)
    free[inside] &= ground.surface[ground.cells(x[inside], y[inside])] != SURFACE_CODE[Surface.WATER]
    for thing in cover:
        if distance_to_segment(np.array([[thing.x, thing.y]]), (tuple(places[0]), tuple(places[-1])))[0] < (
            walk.room + thing.footprint.radius
        ):
            free &= thing.footprint.distance(places) > walk.room
    blocked = np.flatnonzero(~free)
    return STRIDE * (float(blocked[0]) - 1.0 if len(blocked) else len(places) - 1.0)


def _to_and_fro(
    number: int,
    kind: ObstacleKind,
    crossing: np.ndarray,
    heading: np.ndarray,
    reach: tuple[float, float],
    speed: float,
    when: float,
) -> MovingObstacle:
    """One who is at the crossing, walking along the heading, at `when` seconds."""
    before, beyond = reach
    length = before + beyond
    first, last = crossing - before * heading, crossing + beyond * heading
    phase = (before - speed * when) % (2.0 * length)
    forth = phase < length
    place = first + (phase if forth else 2.0 * length - phase) * heading
    beat = (last, first) if forth else (first, last)
    x, y = np.round(place, 2).tolist()
    waypoints = tuple(Point(x=round(float(p[0]), 2), y=round(float(p[1]), 2)) for p in beat)
    return MovingObstacle(
        id=number, kind=kind, x=x, y=y, patrol=Patrol(waypoints=waypoints, speed=speed, loop=True)
    )
