"""Evaluated drives played again over their scene: the one owner of what is replayed and where it stands.

Lives on the studio's loop; those who `watch` hear of every change, while it plays a dozen times a second.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from app.changes import Change, StudioError
from app.results import Drive, Evaluation
from app.results_style import rgb_of
from app.studio import Studio
from planner.scene_recipe import rebuilt
from planner.trajectory import Trajectory
from scenes.pose import Pose
from scenes.scenario import Scenario
from scenes.stance import standing_pose

TICK_S = 1.0 / 12.0
SPEEDS = (0.25, 16.0)


@dataclass(frozen=True, eq=False)
class Actor:
    """One of the drives; status : how it ended."""

    method: str
    status: str
    colour: tuple[int, int, int]
    way: Trajectory

    @property
    def outcome(self) -> str:
        """The status in words."""
        return self.status.replace("_", " ")


@dataclass(frozen=True, eq=False)
class Replay:
    """What is played: one drive, or two of the same mission side by side."""

    title: str
    scenario: Scenario
    actors: tuple[Actor, ...]

    @property
    def duration_s(self) -> float:
        return max(actor.way.duration_s for actor in self.actors)


def _actor(drive: Drive) -> Actor:
    method = drive.mission["method"]
    return Actor(method, drive.mission["status"], rgb_of(method), drive.trajectory)


class ReplayService:
    """See the module's docstring."""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self.replay: Replay | None = None
        self.time_s, self.speed, self.playing = 0.0, 1.0, False
        self._listeners: list[Callable[[], None]] = []
        self._tick: asyncio.TimerHandle | None = None
        self._heightmap = studio.heightmap
        self._leave = studio.subscribe(self._hear)

    def close(self) -> None:
        self.end()
        self._leave()

    def watch(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call `listener` on the loop after every change; returns what ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    async def open(self, evaluation: Evaluation, missions: Sequence[int]) -> None:
        """Open the missions' scene and play their drives from the beginning.

        Raises UnknownEntry, ResultsError, ScenarioError; StudioError for missions of two scenes."""
        if not missions:
            raise StudioError("name a mission to replay")

        def made() -> tuple[Scenario, list[Drive]]:
            recipes = [evaluation.recipe(mission) for mission in missions]
            if any(recipe != recipes[0] for recipe in recipes):
                raise StudioError("the missions are of different scenes; choose two methods of the same one")
            return rebuilt(recipes[0]), [evaluation.drive(mission) for mission in missions]

        scenario, drives = await asyncio.to_thread(made)
        await self.studio.open_document(scenario)
        if self.studio.scenario is not scenario:
            return  # something newer was opened meanwhile
        self._heightmap = self.studio.heightmap
        actors = tuple(_actor(drive) for drive in drives)
        self.replay = Replay(f"{scenario.name} · {evaluation.title}", scenario, actors)
        self.time_s = 0.0
        self.play()

    def end(self) -> None:
        """Take the ghosts away; the scene stays open."""
        self.pause()
        if self.replay is not None:
            self.replay = None
            self._tell()

    def play(self) -> None:
        """Go on; from the beginning where the end was reached. Raises StudioError where there is nothing."""
        replay = self._playable()
        if self.time_s >= replay.duration_s:
            self.time_s = 0.0
        if not self.playing:
            self.playing = True
            self._tick = asyncio.get_running_loop().call_later(TICK_S, self._advance)
        self._tell()

    def pause(self) -> None:
        if self._tick is not None:
            self._tick.cancel()
            self._tick = None
        if self.playing:
            self.playing = False
            self._tell()

    def seek(self, time_s: float) -> None:
        """Show a moment; it goes on from there if it plays. Raises StudioError."""
        replay = self._playable()
        if not time_s >= 0.0:
            raise StudioError(f"time must be 0 or more, got {time_s}")
        self.time_s = min(time_s, replay.duration_s)
        self._tell()

    def set_speed(self, factor: float) -> None:
        """Seconds of the drives a second. Raises StudioError."""
        low, high = SPEEDS
        if not low <= factor <= high:
            raise StudioError(f"speed must be {low:g} to {high:g}, got {factor}")
        self.speed = factor
        self._tell()

    def poses(self) -> list[Pose]:
        """Where the actors stand now, tilted as the ground under them."""
        if self.replay is None:
            return []
        places = [actor.way.at(self.time_s) for actor in self.replay.actors]
        return [standing_pose(self._heightmap, *place) for place in places]

    def _playable(self) -> Replay:
        if self.replay is None:
            raise StudioError("no drive is being replayed; choose one on the results page", 409)
        return self.replay

    def _advance(self) -> None:
        self._tick = None
        replay = self.replay
        if replay is None or not self.playing:
            return
        self.time_s = min(self.time_s + TICK_S * self.speed, replay.duration_s)
        if self.time_s >= replay.duration_s:
            self.playing = False
        else:
            self._tick = asyncio.get_running_loop().call_later(TICK_S, self._advance)
        self._tell()

    def _hear(self, change: Change) -> None:
        if change is Change.OPENED:
            self.end()

    def _tell(self) -> None:
        for listener in tuple(self._listeners):
            listener()
