"""`/api/mission`: what the robot is doing, and the commands to it; `/api/edits`: undo and redo."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import Field

from app.api.bodies import JsonRoute
from app.changes import StudioError
from app.studio import SPEEDS, Studio
from app.telemetry import mission_document
from planner.frames import Perception, Status
from scenes.scenario import Document, Point, Start, between


class MethodChoice(Document):
    name: Annotated[str, Field(min_length=1, max_length=80)]


class PerceptionChoice(Document):
    mode: Perception


class SpeedChoice(Document):
    """Simulated seconds a second."""

    factor: Annotated[float, between(*SPEEDS)]


class SeedChoice(Document):
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)]


def router(studio: Studio) -> APIRouter:
    """Every command answers with the mission document as it is then."""
    routes = APIRouter(prefix="/api", tags=["mission"], route_class=JsonRoute)

    def present() -> dict[str, Any]:
        return mission_document(studio)

    @routes.get("/mission")
    async def mission() -> dict[str, Any]:
        """Status, time, settings, pose (metres, degrees), goal, cover."""
        return present()

    @routes.post("/mission/start")
    async def start() -> dict[str, Any]:
        """Drive to the goal; a mission that is over starts anew."""
        studio.play()
        return present()

    @routes.post("/mission/resume")
    async def resume() -> dict[str, Any]:
        """Go on after a pause."""
        if studio.status is not Status.PAUSED:
            raise StudioError(f"the mission is {studio.status.value}, not paused", 409)
        studio.play()
        return present()

    @routes.post("/mission/pause")
    async def pause() -> dict[str, Any]:
        studio.pause()
        return present()

    @routes.post("/mission/step")
    async def step() -> dict[str, Any]:
        """One control tick, then pause."""
        studio.step()
        return present()

    @routes.post("/mission/reset")
    async def reset() -> dict[str, Any]:
        """Back to the start."""
        studio.reset()
        return present()

    @routes.post("/mission/stop")
    async def stop() -> dict[str, Any]:
        """End the mission where the robot is."""
        studio.stop()
        return present()

    @routes.put("/mission/goal")
    async def set_goal(goal: Point) -> dict[str, Any]:
        """Move the goal; a running mission heads there at once."""
        studio.set_goal(goal.x, goal.y)
        return present()

    @routes.put("/mission/pose")
    async def set_pose(pose: Start) -> dict[str, Any]:
        """Put the robot somewhere, yaw in degrees."""
        studio.set_pose(pose.x, pose.y, pose.yaw)
        return present()

    @routes.put("/mission/method")
    async def set_method(choice: MethodChoice) -> dict[str, Any]:
        studio.set_method(choice.name)
        return present()

    @routes.put("/mission/perception")
    async def set_perception(choice: PerceptionChoice) -> dict[str, Any]:
        studio.set_perception(choice.mode)
        return present()

    @routes.put("/mission/speed")
    async def set_speed(choice: SpeedChoice) -> dict[str, Any]:
        studio.set_speed(choice.factor)
        return present()

    @routes.put("/mission/seed")
    async def set_seed(choice: SeedChoice) -> dict[str, Any]:
        """The seed of sensors and noise, from the next reset on."""
        studio.set_seed(choice.seed)
        return present()

    @routes.post("/edits/undo", tags=["scenarios"])
    async def undo() -> dict[str, Any]:
        """Take back the last edit, whoever made it."""
        studio.undo()
        return present()

    @routes.post("/edits/redo", tags=["scenarios"])
    async def redo() -> dict[str, Any]:
        studio.redo()
        return present()

    return routes
