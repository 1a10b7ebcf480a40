"""What an episode of learning is about: a ground that is kept from episode to episode, and on it a drive of
its own, with new ends, watchers and passers-by each time, all drawn from the generator handed in."""

from __future__ import annotations

import copy
import math
from collections import OrderedDict
from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import Any

import numpy as np
from scipy import ndimage

from planner.shelter import CoverGround
from scenes.families import PASSAGE, generate
from scenes.kinematics import Outlines
from scenes.placement import place_observers, room_to_watch, within_half_turn
from scenes.rays import RayScene
from scenes.scenario import (
    Family,
    MovingObstacle,
    Observer,
    ObstacleKind,
    Patrol,
    Point,
    Scenario,
    ScenarioError,
    Start,
)
from scenes.terrain import Heightmap
from scenes.traversability import blocked_cells, reachable

FIRST_GROUND = 1_000_000
"""Seed of the first ground to learn on; evaluations count theirs from 0, so that they are held out."""

USUAL_GOAL_DISTANCE = 12.0
NEAREST_GOAL = 3.0
ENDS_DRAWN = 2000
DISTANCE_SLACK = 0.1
MAP_SIZES = (48.0, 80.0, 160.0)  # few, so that grounds are met again
BEAT, CROSSING = (3.0, 8.0), 4.0  # metres a patrol walks before it turns; a passer-by, aside of the way

Place = tuple[float, float]


@dataclass(frozen=True)
class Task:
    """What episodes are drawn from.

    goal_distance : metres, give or take a tenth
    observers : how many watch; patrols : whether they walk a beat; known : whether the robot is told of them
    obstacles : people who walk across the way
    """

    terrain: Family = Family.NORMAL
    goal_distance: float = USUAL_GOAL_DISTANCE
    observers: int = 1
    patrols: bool = False
    known: bool = True
    obstacles: int = 0

    def __post_init__(self) -> None:
        """Raises ValueError for what makes no sense."""
        object.__setattr__(self, "terrain", Family(self.terrain))
        if not isinstance(self.goal_distance, Real) or isinstance(self.goal_distance, bool):
            raise ValueError(f"the goal distance must be metres, got {self.goal_distance!r}")
        for name in ("observers", "obstacles"):
            count = getattr(self, name)
            if not isinstance(count, Integral) or isinstance(count, bool):
                raise ValueError(f"the number of {name} must be a whole number, got {count!r}")
        for name in ("patrols", "known"):
            if not isinstance(getattr(self, name), bool | np.bool_):
                raise ValueError(f"{name} must be true or false, got {getattr(self, name)!r}")
        if not (math.isfinite(self.goal_distance) and 1.0 <= self.goal_distance <= 100.0):
            raise ValueError(f"the goal distance is {self.goal_distance} m; it must be 1 to 100 m")
        for name, count, most in (("observers", self.observers, 20), ("obstacles", self.obstacles, 20)):
            if not 0 <= count <= most:
                raise ValueError(f"the number of {name} is {count}; it must be 0 to {most}")

    @property
    def map_size(self) -> float:
        """Side of the square map in metres: room for the drive and a detour around it."""
        return next(size for size in MAP_SIZES if 1.6 * self.goal_distance <= size)


def task_like(scenario: Scenario) -> Task:
    """Drives as far, and as watched, as the scenario's own. Raises ValueError where its goal is too far."""
    start, goal = scenario.start, scenario.goal
    return Task(
        goal_distance=round(max(math.hypot(start.x - goal.x, start.y - goal.y), NEAREST_GOAL), 1),
        observers=min(len(scenario.observers), 20),
        patrols=any(observer.patrol is not None for observer in scenario.observers),
        known=all(observer.known for observer in scenario.observers),
        obstacles=min(len(scenario.obstacles), 20),
    )


def reset_options(task: Task) -> dict[str, Any]:
    """The task as options of the environment's reset, without the terrain: for a ground that is given."""
    return {field.name: getattr(task, field.name) for field in fields(Task) if field.name != "terrain"}


class Ground:
    """A scenario's terrain and cover, and what is made of them once: rays, outlines, where one can drive.

    scenario : start and goal are its own; whoever learns on it draws others
    """

    def __init__(self, scenario: Scenario):
        self.scenario = scenario
        self.heightmap: Heightmap = scenario.terrain.heightmap()
        self.outlines = Outlines.of(self.heightmap, scenario.cover)
        self.cover = CoverGround(self.heightmap, scenario.cover)
        self._rays = RayScene(self.heightmap, scenario.cover)
        eye = np.array([0.0, 0.0, self.heightmap.heights.max() + 1.0])
        self._rays.visible(eye[None], eye[None] + 1.0)  # the trees for lines of sight are made at first use
        blocked = blocked_cells(self.heightmap, scenario.cover, 0.5 * PASSAGE)
        self._regions = np.asarray(ndimage.label(~blocked)[0])  # type: ignore[index]

    def rays(self) -> RayScene:
        """The ray scene with no walkers, for one episode alone; the trees are shared."""
        rays = copy.copy(self._rays)
        rays.set_walkers()
        return rays

    def draw(self, task: Task, rng: np.random.Generator) -> Scenario:
        """A drive on this ground. Raises ScenarioError, naming it, where no goal can be reached."""
        start, goal = self._ends(task.goal_distance, rng)
        spread = 45.0 if rng.random() < 0.85 else 120.0
        bearing = math.degrees(math.atan2(goal[1] - start[1], goal[0] - start[0]))
        cover = self.scenario.cover
        watchers = place_observers(rng, self.heightmap, cover, (start, goal), task.observers)
        update = {
            "start": Start(
                x=start[0], y=start[1], yaw=within_half_turn(bearing + rng.uniform(-spread, spread))
            ),
            "goal": Point(x=goal[0], y=goal[1]),
            "observers": tuple(self._instructed(watcher, task, (start, goal), rng) for watcher in watchers),
            "obstacles": tuple(self._passers_by(task.obstacles, start, goal, rng)),
        }
        return self.scenario.model_copy(update=update)

    def _ends(self, distance: float, rng: np.random.Generator) -> tuple[Place, Place]:
        """Start and goal, with room to turn, and free ground between them somewhere."""
        ground, regions = self.heightmap, self._regions
        free = np.flatnonzero(regions)
        turn = rng.uniform(-math.pi, math.pi, ENDS_DRAWN)
        reach = distance * rng.uniform(1.0 - DISTANCE_SLACK, 1.0 + DISTANCE_SLACK, ENDS_DRAWN)
        pick = rng.random(ENDS_DRAWN)
        if len(free):
            row, col = np.divmod(free[(pick * len(free)).astype(int)], regions.shape[1])
            x, y = ground.x_min + col * ground.resolution, ground.y_min + row * ground.resolution
            goal_x, goal_y = x + reach * np.cos(turn), y + reach * np.sin(turn)
            west, east, south, north = ground.bounds
            fits = (goal_x > west) & (goal_x < east) & (goal_y > south) & (goal_y < north)
            fits &= regions[ground.cells(goal_x, goal_y)] == regions[row, col]
            for index in np.flatnonzero(fits)[:1]:
                return (float(x[index]), float(y[index])), (float(goal_x[index]), float(goal_y[index]))
        raise ScenarioError(
            f"scenario '{self.scenario.name}' has no reachable goal {distance:g} m from anywhere on it;"
            " take a shorter distance or another ground"
        )

    def _instructed(
        self, watcher: Observer, task: Task, route: tuple[Place, Place], rng: np.random.Generator
    ) -> Observer:
        patrol = self._beat(watcher, route, rng) if task.patrols else None
        return watcher.model_copy(update={"known": task.known, "patrol": patrol})

    def _beat(self, watcher: Observer, route: tuple[Place, Place], rng: np.random.Generator) -> Patrol | None:
        """To a place nearby and back; None where there is none."""
        turn, reach = rng.uniform(-math.pi, math.pi, 32), rng.uniform(*BEAT, 32)
        places = np.column_stack([watcher.x + reach * np.cos(turn), watcher.y + reach * np.sin(turn)])
        speed = round(float(rng.uniform(0.5, 1.2)), 2)
        for x, y in places[self._standable(places, route)].tolist():
            return Patrol(waypoints=(Point(x=x, y=y),), speed=speed, loop=False)
        return None

    def _standable(self, places: np.ndarray, route: tuple[Place, Place]) -> np.ndarray:
        west, east, south, north = self.heightmap.bounds
        x, y = places.T
        inside = (x > west) & (x < east) & (y > south) & (y < north)
        return inside & room_to_watch(self.heightmap, self.scenario.cover, route, places)

    def _passers_by(
        self, count: int, start: Place, goal: Place, rng: np.random.Generator
    ) -> list[MovingObstacle]:
        """People who walk to and fro across the way, clear of both its ends."""
        middle, along = 0.5 * np.add(start, goal), np.subtract(goal, start)
        aside = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
        west, east, south, north = self.heightmap.bounds
        people = []
        for number in range(1, count + 1):
            place = middle + rng.uniform(-0.2, 0.2) * along
            ends = np.clip([place - CROSSING * aside, place + CROSSING * aside], (west, south), (east, north))
            (x, y), (to_x, to_y) = ends[:: rng.choice((-1, 1))].tolist()
            patrol = Patrol(
                waypoints=(Point(x=to_x, y=to_y),), speed=round(float(rng.uniform(0.5, 1.2)), 2), loop=False
            )
            people.append(MovingObstacle(id=number, kind=ObstacleKind.PERSON, x=x, y=y, patrol=patrol))
        return people


class Grounds:
    """The grounds last used, `capacity` of them; which are kept changes how long a reset takes, nothing else.

    variety : how many grounds of each terrain there are to learn on
    """

    def __init__(self, variety: int = 12, capacity: int = 24):
        if variety < 1 or capacity < 1:
            raise ValueError(f"there must be at least one ground, got {variety} and room for {capacity}")
        self.variety, self.capacity = variety, capacity
        self._kept: OrderedDict[tuple[Family, int, float], Ground] = OrderedDict()

    def draw(self, task: Task, rng: np.random.Generator) -> Ground:
        """One of the terrain's grounds."""
        seed = FIRST_GROUND + int(rng.integers(self.variety))
        key = task.terrain, seed, task.map_size
        if key not in self._kept:
            self._kept[key] = Ground(
                generate(
                    task.terrain, seed, size_m=task.map_size, goal_distance=USUAL_GOAL_DISTANCE, observers=0
                )
            )
        self._kept.move_to_end(key)
        while len(self._kept) > self.capacity:
            self._kept.popitem(last=False)
        return self._kept[key]


def check_reachable(scenario: Scenario) -> None:
    """Raises ScenarioError, naming the scenario, where no drivable ground joins its start and its goal."""
    start, goal = scenario.start, scenario.goal
    if not reachable(scenario.terrain.heightmap(), scenario.cover, (start.x, start.y), (goal.x, goal.y)):
        raise ScenarioError(
            f"scenario '{scenario.name}' has no reachable goal: nothing that a Husky can drive on joins"
            f" ({start.x:g}, {start.y:g}) and ({goal.x:g}, {goal.y:g})"
        )


def check_ground(scenario: Scenario) -> None:
    """Raises ScenarioError, naming the scenario, where no drives like its own can be drawn on its ground."""
    try:
        task = task_like(scenario)
    except ValueError as error:
        raise ScenarioError(f"scenario '{scenario.name}': {error}; move its goal nearer") from None
    Ground(scenario).draw(task, np.random.default_rng(0))
