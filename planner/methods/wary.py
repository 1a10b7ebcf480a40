"""Covert routes with the observers that the robot knows: hidden from the others it is only by luck, or by
heeding a belief over where they may stand."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy import ndimage

from planner.belief import Belief
from planner.covert_route import CovertPlanner
from planner.frames import CostPatch, Decision, Percept
from planner.hull_exposure import HullExposure, hull_exposure
from planner.methods.route import FollowRoute, most_hidden
from scenes.rays import RayScene
from scenes.scenario import Observer, Scenario

MOVED = 2.0
"""Metres that a spotted observer must have gone before the robot plans anew."""

LOOK_PERIOD, REPLAN_PERIOD = 0.5, 4.0
"""Seconds between looks that rule places out, and between routes on account of them."""

NEAR = 2.0
"""Metres from the goal within which a belief changes nothing any more."""

BELIEF_STRIDE = 3


class BelievingPlanner(CovertPlanner):
    """Counts what an observer not yet seen may see beside what the known ones do.

    belief : (rows, cols) chance to be seen, over every BELIEF_STRIDE-th cell of the map; None counts for none
    """

    belief: np.ndarray | None = None

    @cached_property
    def exposure(self) -> HullExposure:
        known = hull_exposure(self.rays, self.heightmap, self.observers, stride=self._stride)
        if self.belief is None:
            return known
        chance = _spread(np.nan_to_num(self.belief, nan=1.0), known.fraction.shape[1:])
        fraction = known.fraction + (1.0 - known.fraction) * chance
        return HullExposure(known.x_min, known.y_min, known.resolution, fraction)


def _spread(coarse: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """A coarse grid over the same ground, interpolated to a finer shape."""
    row, col = (
        np.clip((np.arange(size) + 0.5) * part / size - 0.5, 0.0, part - 1.0)
        for size, part in zip(shape, coarse.shape, strict=True)
    )
    return ndimage.map_coordinates(coarse, np.meshgrid(row, col, indexing="ij"), order=1).astype(np.float32)


class Wary(FollowRoute):
    """Knows the ground and the cover, and of the observers those that its percept has: it follows the most
    hidden route as far as it knows, and plans anew when it spots another.

    believes : heed where observers not yet seen may stand; off unless told
    """

    def __init__(self, name: str, seed: int = 0, believes: bool = False):
        super().__init__(name, most_hidden)
        self._seed, self._believes = seed, believes
        self._scenario: Scenario | None = None
        self._belief: Belief | None = None
        self._layer: CostPatch | None = None
        self._known: tuple[Observer, ...] = ()
        self._looked_s = self._planned_s = -math.inf

    def brief(self, scenario: Scenario, rays: RayScene) -> None:
        """Take over ground and cover; of the observers the percepts tell."""
        self._scenario, self._rays = scenario, rays
        self._belief = None
        self._forget()

    def reset(self) -> None:
        super().reset()
        self._belief = None
        self._forget()

    def decide(self, percept: Percept) -> Decision:
        if self._scenario is None:
            raise RuntimeError("the method must be briefed with the scenario before it decides")
        self._look(percept)
        overdue = self._believes and percept.time_s - self._planned_s >= REPLAN_PERIOD
        overdue = overdue and percept.goal_distance > NEAR
        if self._planner is None or overdue or _changed(self._known, percept.observers):
            self._known, self._planned_s = percept.observers, percept.time_s
            self._planner = self._planner_for(self._scenario)
            self._places = np.zeros((0, 2))
        return replace(super().decide(percept), belief=self._layer)

    def _forget(self) -> None:
        self._planner = None
        self._known = ()
        self._layer = None
        self._looked_s = self._planned_s = -math.inf

    def _planner_for(self, scenario: Scenario) -> CovertPlanner:
        heightmap = scenario.terrain.heightmap()
        planner = BelievingPlanner(heightmap, scenario.cover, self._known, self._rays)
        if self._belief is not None:
            planner.belief = self._belief.exposure(stride=BELIEF_STRIDE)
            first, resolution = (BELIEF_STRIDE - 1) // 2, heightmap.resolution
            self._layer = CostPatch(
                heightmap.x_min + first * resolution,
                heightmap.y_min + first * resolution,
                BELIEF_STRIDE * resolution,
                100.0 * planner.belief,
            )
        return planner

    def _look(self, percept: Percept) -> None:
        if not self._believes or self._scenario is None:
            return
        pose = percept.pose
        if self._belief is None:
            scenario, route = self._scenario, ((pose.x, pose.y), percept.goal)
            heightmap, rng = scenario.terrain.heightmap(), np.random.default_rng(self._seed)
            self._belief = Belief(self._rays, heightmap, scenario.cover, route, rng)
        if percept.time_s - self._looked_s >= LOOK_PERIOD:
            self._looked_s = percept.time_s
            self._belief.look(pose)

    def __getstate__(self):
        return super().__getstate__() | {"_rays": None, "_belief": None, "_scenario": None}


def _changed(before: tuple[Observer, ...], now: tuple[Observer, ...]) -> bool:
    """Whether another observer is known, one is gone, or one has moved."""
    if [observer.id for observer in before] != [observer.id for observer in now]:
        return True
    return any(math.dist((a.x, a.y), (b.x, b.y)) > MOVED for a, b in zip(before, now, strict=True))
