"""The plain dynamic window approach: straight for the goal, whatever lies between."""

from __future__ import annotations

from planner.cost_map import CostConfig, ground_near
from planner.cover import best_cover
from planner.driver import Driver, DriverConfig
from planner.frames import Decision, Percept, Status

GROUND_REACH = 3.2
"""Metres: farther than an arc and the wheels on it get."""


class PlainDwa:
    """The paper's baseline (Fox et al. 1997), with nothing but the arcs to look ahead."""

    name = "dwa"

    def __init__(self, config: DriverConfig | None = None):
        self.driver = Driver(config)
        self._cost = CostConfig()

    def reset(self) -> None:
        self.driver.reset()

    def decide(self, percept: Percept) -> Decision:
        ground = ground_near(percept.grid, percept.pose.x, percept.pose.y, GROUND_REACH, self._cost)
        driven = self.driver.drive(percept, percept.goal, ground)
        return Decision(
            driven.command,
            waypoint=percept.goal,
            arcs=driven.arcs,
            cover_id=best_cover(percept),
            note=driven.note,
            failure=Status.STUCK if driven.stuck else None,
        )
