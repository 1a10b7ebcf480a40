"""The tools: what a click on the scene means while one of them is armed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from app.changes import Kind, Selection, StudioError
from app.studio import Studio
from app.view.picking import Pick
from scenes.catalogue import CoverKind
from scenes.scenario import CoverSpec, ObserverSpec, ObstacleKind, ObstacleSpec


class Tool(StrEnum):
    GOAL = "goal"
    START = "start"
    OBSERVER = "observer"
    COVER = "cover"
    OBSTACLE = "obstacle"
    PATROL = "patrol"
    MOVE = "move"
    ROTATE = "rotate"
    DELETE = "delete"
    ROBOT = "robot"
    EXPLAIN = "explain"


HINTS: dict[Tool, str] = {
    Tool.GOAL: "Click the ground where the robot shall drive",
    Tool.START: "Click the ground where drives begin",
    Tool.OBSERVER: "Click the ground to place an observer",
    Tool.COVER: "Click the ground to place cover",
    Tool.OBSTACLE: "Click the ground to place somebody who moves",
    Tool.PATROL: "Click the waypoints of the selected walker",
    Tool.MOVE: "Click a thing, then drag it or click where it shall stand",
    Tool.ROTATE: "Click a thing, then turn it or click where it shall face",
    Tool.DELETE: "Click what shall go",
    Tool.ROBOT: "Click where to put the robot now",
    Tool.EXPLAIN: "Click a place: who would see the robot there, and why",
}


@dataclass
class Armed:
    """What one person holds: a tool or nothing, and the kinds that its clicks place."""

    tool: Tool | None = None
    cover: CoverKind = CoverKind.BUSH
    obstacle: ObstacleKind = ObstacleKind.PERSON


def click(studio: Studio, armed: Armed, pick: Pick) -> None:
    """Do what a click means. Raises StudioError or ScenarioError where it is refused."""
    tool = armed.tool
    if tool is None:
        studio.select(pick.thing)
    elif tool is Tool.DELETE:
        if pick.thing is None:
            raise StudioError("there is nothing here to delete")
        studio.remove(pick.thing)
    elif tool in (Tool.MOVE, Tool.ROTATE):
        _adjust(studio, tool, pick)
    elif tool is Tool.PATROL and pick.thing is not None and pick.thing.kind in (Kind.OBSERVER, Kind.OBSTACLE):
        studio.select(pick.thing)
    elif pick.point is None:
        raise StudioError("that is beyond the map: click the ground")
    else:
        _place(studio, armed, *pick.point)


def _adjust(studio: Studio, tool: Tool, pick: Pick) -> None:
    held = studio.selection
    if held is None or (pick.thing is not None and pick.thing != held):
        studio.select(pick.thing)
    elif pick.point is not None and pick.thing is None:
        if tool is Tool.MOVE:
            move(studio, held, *pick.point)
        else:
            thing = studio.find(held)
            turn(studio, held, math.degrees(math.atan2(pick.point[1] - thing.y, pick.point[0] - thing.x)))


def _place(studio: Studio, armed: Armed, x: float, y: float) -> None:
    match armed.tool:
        case Tool.GOAL:
            studio.set_goal(x, y)
        case Tool.START:
            studio.set_start(x, y)
        case Tool.ROBOT:
            studio.set_pose(x, y, math.degrees(studio.frame.pose.yaw) if studio.frame is not None else 0.0)
        case Tool.OBSERVER:
            _on_map(studio, x, y)
            observer = studio.add_observer(ObserverSpec(x=x, y=y, yaw=_toward_drive(studio, x, y)))
            studio.select(Selection(Kind.OBSERVER, observer.id))
        case Tool.COVER:
            _on_map(studio, x, y)
            cover = studio.add_cover(CoverSpec(kind=armed.cover, x=x, y=y))
            studio.select(Selection(Kind.COVER, cover.id))
        case Tool.OBSTACLE:
            _on_map(studio, x, y)
            obstacle = studio.add_obstacle(ObstacleSpec(kind=armed.obstacle, x=x, y=y))
            studio.select(Selection(Kind.OBSTACLE, obstacle.id))
        case Tool.PATROL:
            _add_waypoint(studio, x, y)


def _on_map(studio: Studio, x: float, y: float) -> None:
    reason = studio.off_the_map(x, y)
    if reason:
        raise StudioError(f"the click {reason}")


def _toward_drive(studio: Studio, x: float, y: float) -> float:
    """Degrees from (x, y) to the middle between start and goal: what a watcher would look at."""
    start, goal = studio.scenario.start, studio.scenario.goal
    return round(math.degrees(math.atan2(0.5 * (start.y + goal.y) - y, 0.5 * (start.x + goal.x) - x)), 1)


def _add_waypoint(studio: Studio, x: float, y: float) -> None:
    held = studio.selection
    if held is None or held.kind not in (Kind.OBSERVER, Kind.OBSTACLE):
        raise StudioError("click an observer or a moving obstacle first, then the points of its patrol")
    _on_map(studio, x, y)
    patrol = studio.find(held).patrol
    beat: dict[str, Any] = patrol.model_dump() if patrol is not None else {"waypoints": ()}
    update(studio, held, {"patrol": beat | {"waypoints": (*beat["waypoints"], {"x": x, "y": y})}})


def move(studio: Studio, thing: Selection, x: float, y: float, drag: str | None = None) -> None:
    """Put a thing of the scenario at (x, y) metres."""
    match thing.kind:
        case Kind.GOAL:
            studio.set_goal(x, y, drag=drag)
        case Kind.START:
            studio.set_start(x, y, drag=drag)
        case _:
            update(studio, thing, {"x": x, "y": y}, drag)


def turn(studio: Studio, thing: Selection, yaw_deg: float, drag: str | None = None) -> None:
    """Make a thing face `yaw_deg`. Raises StudioError for the goal, which has no facing."""
    if thing.kind is Kind.GOAL:
        raise StudioError("the goal has no facing to turn")
    yaw = round(yaw_deg, 1)
    if thing.kind is Kind.START:
        start = studio.scenario.start
        studio.set_start(start.x, start.y, yaw, drag=drag)
    else:
        update(studio, thing, {"yaw": yaw}, drag)


def update(studio: Studio, thing: Selection, changes: dict[str, Any], drag: str | None = None) -> None:
    """Change fields of a thing, whatever its kind."""
    match thing.kind:
        case Kind.OBSERVER:
            studio.update_observer(thing.id, changes, drag=drag)
        case Kind.COVER:
            studio.update_cover(thing.id, changes, drag=drag)
        case Kind.OBSTACLE:
            studio.update_obstacle(thing.id, changes, drag=drag)
        case Kind.GOAL:
            goal = studio.scenario.goal.model_dump() | changes
            studio.set_goal(goal["x"], goal["y"], drag=drag)
        case Kind.START:
            start = studio.scenario.start.model_dump() | changes
            studio.set_start(start["x"], start["y"], start["yaw"], drag=drag)
