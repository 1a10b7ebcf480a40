"""Routes and places worked out beside the server, in a process of its own: planning holds the interpreter for
longer than a page can wait."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.covert_route import CovertPlanner, CovertRoute
from planner.methods.route import balanced, most_hidden, shortest
from planner.no_route import NoRoute
from planner.vantage import Vantage, best_vantages, nearest_hiding_place
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.scenario import CoverObject, Observer
from scenes.terrain import Heightmap

CHOICES = {"route_shortest": shortest, "route_balanced": balanced, "route": most_hidden}
"""The methods that follow a route, with what they choose."""


@dataclass(frozen=True)
class Situation:
    """Where the robot is on which map, and who watches.

    map_id : the same for the same map, so that what was built of it is used again
    """

    map_id: int
    heightmap: Heightmap
    cover: tuple[CoverObject, ...]
    observers: tuple[Observer, ...]
    pose: Pose
    goal: tuple[float, float]
    time_s: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """Routes by the methods that follow them; or why there is none, and the place that this is about."""

    routes: dict[str, CovertRoute]
    reason: str = ""
    where: tuple[float, float] | None = None


_kept: tuple[tuple, CovertPlanner] | None = None


def compare(situation: Situation) -> Comparison:
    """The shortest, a balanced and the most hidden route from where the robot is to its goal."""
    planner = _planner(situation)
    try:
        return Comparison({name: choose(planner, situation) for name, choose in CHOICES.items()})
    except NoRoute as error:
        return Comparison({}, error.reason, error.where)


def watchers(situation: Situation, points: np.ndarray | None, count: int) -> tuple[Vantage, ...]:
    """Where `count` watchers see most of a route (k, 2), or of the shortest one. Raises NoRoute."""
    planner = _planner(situation)
    way = shortest(planner, situation).points if points is None else points
    return best_vantages(planner, way, count)


def hiding_place(situation: Situation) -> CovertRoute:
    """The quickest way to where nobody sees the robot. Raises NoRoute."""
    pose = situation.pose
    return nearest_hiding_place(_planner(situation), (pose.x, pose.y), pose.yaw)


def _planner(situation: Situation) -> CovertPlanner:
    """The last question's planner, where that was about the same scene."""
    global _kept
    scene = (situation.map_id, situation.cover, situation.observers)
    if _kept is None or _kept[0] != scene:
        same = _kept is not None and _kept[0][:2] == scene[:2]
        rays = _kept[1].rays if _kept is not None and same else RayScene(situation.heightmap, situation.cover)
        ground = _kept[1].heightmap if _kept is not None and same else situation.heightmap
        _kept = scene, CovertPlanner(ground, situation.cover, situation.observers, rays)
    return _kept[1]
