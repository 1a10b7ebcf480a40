"""The one owner of the live state: applies edits and commands in order, remembers undo, follows the mission.

Every method runs on the event loop's thread; other threads use `post`. REST, the telemetry socket and the 3D
view call the same commands and hear of the same changes.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app import scene_edits
from app.changes import Change, Kind, Overlay, Selection, StudioError
from app.drive import Drive
from app.history import History
from app.store import UNSAVED, UNSAVED_ID, ScenarioEntry, Store, StoreError
from app.switchboard import Switchboard
from app.timeline import Timeline
from planner.frames import Frame, Perception, Status
from planner.methods import DEFAULT_METHOD, METHODS, with_motion
from scenes.families import generate
from scenes.scenario import (
    CoverObject,
    CoverSpec,
    Document,
    Family,
    MovingObstacle,
    Observer,
    ObserverSpec,
    ObstacleSpec,
    Point,
    Scenario,
    ScenarioError,
    Start,
    off_the_map,
    why_not_standing,
)
from scenes.survey import import_survey

SPEEDS = (0.125, 8.0)
LIVE_FIELDS = ("goal", "cover", "observers", "obstacles")


class Studio(Switchboard):
    """See the module's docstring. `store` is the workspace, `scenario` the document to begin with."""

    def __init__(self, store: Store, scenario: Scenario, scenario_id: str) -> None:
        super().__init__()
        self.store = store
        self.scenario, self.scenario_id = scenario, scenario_id
        self.heightmap = scenario.terrain.heightmap()
        self.method, self.perception, self.seed, self.speed = DEFAULT_METHOD, Perception.LIDAR, 0, 1.0
        self.weights: Path | None = None
        self.selection: Selection | None = None
        self.edits = 0
        self.overlay: Overlay | None = None
        self._saved = scenario
        self._history = History()
        self._opening = 0
        self._drive = Drive(store, self.tell, self.background)

    async def start(self) -> None:
        """Start the mission process and load the scenario."""
        self._loop = asyncio.get_running_loop()
        self._load()
        self._drive.start(self._loop)

    async def close(self) -> None:
        """Store the present run, end the mission process."""
        self._drive.finish(Status.STOPPED)
        if self._tasks:
            await asyncio.wait(self._tasks, timeout=5.0)
        await asyncio.to_thread(self._drive.worker.close)

    # the mission as last reported

    @property
    def frame(self) -> Frame | None:
        return self._drive.frame

    @property
    def status(self) -> Status:
        return self._drive.status

    @property
    def message(self) -> str:
        """What is happening, in words."""
        return self._drive.message

    @property
    def error(self) -> str | None:
        return self._drive.error

    @property
    def real_factor(self) -> float:
        """Simulated seconds a second as achieved, 0 while not driving."""
        return self._drive.real_factor

    @property
    def summary(self) -> dict[str, Any] | None:
        """The run so far, as `covernav run --json`."""
        return self._drive.summary

    @property
    def timeline(self) -> Timeline:
        """How exposed the drive was, tick by tick."""
        return self._drive.timeline

    def say(self, message: str) -> None:
        self._drive.say(message)

    def show_overlay(self, overlay: Overlay) -> None:
        """Note that the view has sent this picture of the exposure to everybody who looks."""
        self.overlay = overlay
        self.tell(Change.OVERLAY)

    # documents

    def library(self) -> list[ScenarioEntry]:
        return self.store.scenarios()

    @property
    def dirty(self) -> bool:
        """Whether the scenario differs from what is saved."""
        return self.scenario is not self._saved

    async def open(self, scenario_id: str) -> None:
        """Open a shipped or saved scenario. Raises UnknownEntry, ScenarioError."""
        await self._open_with(lambda: (self.store.load(scenario_id), scenario_id))

    async def open_document(self, scenario: Scenario, scenario_id: str | None = None) -> None:
        """Open a document; without an id it is new and unsaved."""
        await self._open_with(lambda: (scenario, scenario_id or self.store.new_id(scenario.name)))

    async def generate(
        self, family: str, seed: int, size_m: float = 48.0, goal_distance: float = 12.0
    ) -> None:
        """Open a newly generated scenario. Raises StudioError, ScenarioError."""
        if family not in set(Family):
            raise StudioError(f"there is no terrain {family!r:.40}; choose one of {', '.join(Family)}")

        def make() -> tuple[Scenario, str]:
            scenario = generate(Family(family), seed, size_m=size_m, goal_distance=goal_distance)
            return scenario, self.store.new_id(scenario.name)

        await self._open_with(make)

    async def import_file(self, path: Path, filename: str, **options) -> str:
        """Read an uploaded scenario document or survey, save it, open it; returns its id.

        Raises ScenarioError, StoreError."""

        def read() -> tuple[Scenario, str]:
            if Path(filename).suffix.lower() == ".json":
                scenario = Scenario.load(path)
            else:
                scenario = import_survey(path, name=Path(filename).stem[:60] or "survey", **options)
            return scenario, self.store.add(scenario)

        scenario_id = await self._open_with(read)
        self.tell(Change.LIBRARY)
        return scenario_id

    async def _open_with(self, read: Callable[[], tuple[Scenario, str]]) -> str:
        self._opening += 1
        mine = self._opening
        scenario, scenario_id = await asyncio.to_thread(read)
        if mine == self._opening and self.dirty:
            await self._keep_unsaved()
        if mine != self._opening:
            return scenario_id  # a newer request has overtaken this one
        self._drive.finish(Status.STOPPED)
        self.scenario, self.scenario_id, self._saved = scenario, scenario_id, scenario
        if scenario_id == UNSAVED_ID:  # it stays unsaved, under a name of its own
            self.scenario = scenario.revised(name=scenario.name.removesuffix(UNSAVED) or scenario.name)
            self.scenario_id = self.store.new_id(self.scenario.name)
        self.heightmap = scenario.terrain.heightmap()
        self.edits += 1
        self._history.clear()
        self.selection = None
        self._load()
        self.tell(Change.OPENED)
        return scenario_id

    async def _keep_unsaved(self) -> None:
        """What is about to make way for another scenario stays in the library, the last such one alone."""
        with contextlib.suppress(StoreError):  # what is asked for opens on a full disk, too
            await asyncio.to_thread(self.store.keep_unsaved, self.scenario)
            self.tell(Change.LIBRARY)

    def save(self) -> str:
        """Save under the present id; a shipped scenario is saved as a copy. Raises StoreError."""
        if self.store.is_shipped(self.scenario_id):
            return self.save_as(self.scenario.name)
        self.store.save(self.scenario_id, self.scenario)
        self._saved = self.scenario
        self.tell(Change.LIBRARY, Change.SETTINGS)
        return self.scenario_id

    def save_as(self, name: str) -> str:
        """Save under a new name and go on with that. Raises StudioError, StoreError."""
        try:
            scenario = self.scenario.revised(name=name)
        except ScenarioError as error:
            raise StudioError(str(error)) from None
        scenario_id = self.store.new_id(name)
        self.store.save(scenario_id, scenario)
        self.scenario = self._saved = scenario
        self.scenario_id = scenario_id
        self.tell(Change.LIBRARY, Change.SETTINGS)
        return scenario_id

    def duplicate(self) -> str:
        """Save a copy and go on with it."""
        return self.save_as(f"{self.scenario.name[:70]} copy")

    async def add(self, scenario: Scenario) -> str:
        """Save a document under a new id, without opening it. Raises StoreError."""
        scenario_id = await asyncio.to_thread(self.store.add, scenario)
        self.tell(Change.LIBRARY)
        return scenario_id

    async def replace(self, scenario_id: str, scenario: Scenario) -> None:
        """Replace a saved document; the open one stays as it is.

        Raises StudioError for a shipped one, UnknownEntry, StoreError."""
        if self.store.is_shipped(scenario_id):
            raise StudioError(f"{scenario_id} is shipped with the studio: save under another name", 409)
        if scenario_id == UNSAVED_ID:
            raise StudioError(f"{scenario_id} holds unsaved changes: save under another name", 409)
        self.store.path(scenario_id)
        await asyncio.to_thread(self.store.save, scenario_id, scenario)
        if scenario_id == self.scenario_id:
            self._saved = scenario
        self.tell(Change.LIBRARY, Change.SETTINGS)

    def delete(self, scenario_id: str) -> None:
        """Delete a saved scenario. Raises StudioError for a shipped one, UnknownEntry."""
        if self.store.is_shipped(scenario_id):
            raise StudioError(f"{scenario_id} is shipped with the studio and cannot be deleted", 409)
        self.store.delete(scenario_id)
        self.tell(Change.LIBRARY)

    # edits

    @property
    def can_undo(self) -> bool:
        return self._history.can_undo

    @property
    def can_redo(self) -> bool:
        return self._history.can_redo

    def undo(self) -> None:
        if not self._history.can_undo:
            raise StudioError("there is nothing to undo", 409)
        self._keep_off_the_robot(self._history.before)
        self._adopt(self._history.undo(self.scenario))

    def redo(self) -> None:
        if not self._history.can_redo:
            raise StudioError("there is nothing to redo", 409)
        self._keep_off_the_robot(self._history.after)
        self._adopt(self._history.redo(self.scenario))

    def _edit(self, drag: str | None, **changes: Any) -> None:
        """Replace fields of the scenario as one undo entry; `drag` merges edits that carry the same token."""
        try:
            after = self.scenario.revised(**changes)
        except ScenarioError as error:
            raise StudioError(str(error)) from None
        self._keep_off_the_robot(after)
        self._history.edited(self.scenario, drag)
        self._adopt(after)

    def _keep_off_the_robot(self, after: Scenario) -> None:
        if self.frame is not None:
            pose = self.frame.pose
            scene_edits.keep_off_the_robot(self.scenario, after, pose.x, pose.y, self.frame.time_s)

    def _adopt(self, after: Scenario) -> None:
        before, self.scenario = self.scenario, after
        self.edits += 1
        changed = tuple(name for name in LIVE_FIELDS if getattr(before, name) != getattr(after, name))
        if before.start != after.start and self.status is Status.IDLE:
            self._load()
        elif changed:
            self._drive.edit(after, changed)
        if self.selection is not None and not scene_edits.exists(self.scenario, self.selection):
            self.selection = None
            self.tell(Change.SELECTED)
        self.tell(Change.EDITED)

    def set_goal(self, x: float, y: float, *, drag: str | None = None) -> None:
        self._edit(drag, goal=scene_edits.validated(Point, {"x": x, "y": y}))

    def set_start(self, x: float, y: float, yaw_deg: float | None = None, *, drag: str | None = None) -> None:
        yaw = self.scenario.start.yaw if yaw_deg is None else yaw_deg
        self._edit(drag, start=scene_edits.validated(Start, {"x": x, "y": y, "yaw": yaw}))

    def add_observer(self, spec: ObserverSpec) -> Observer:
        return self._add(Kind.OBSERVER, spec)

    def update_observer(self, id: int, changes: dict[str, Any], *, drag: str | None = None) -> Observer:
        return self._update(Kind.OBSERVER, id, changes, drag)

    def delete_observer(self, id: int) -> None:
        self.remove(Selection(Kind.OBSERVER, id))

    def add_cover(self, spec: CoverSpec) -> CoverObject:
        return self._add(Kind.COVER, spec)

    def update_cover(self, id: int, changes: dict[str, Any], *, drag: str | None = None) -> CoverObject:
        return self._update(Kind.COVER, id, changes, drag)

    def delete_cover(self, id: int) -> None:
        self.remove(Selection(Kind.COVER, id))

    def add_obstacle(self, spec: ObstacleSpec) -> MovingObstacle:
        return self._add(Kind.OBSTACLE, spec)

    def update_obstacle(self, id: int, changes: dict[str, Any], *, drag: str | None = None) -> MovingObstacle:
        return self._update(Kind.OBSTACLE, id, changes, drag)

    def delete_obstacle(self, id: int) -> None:
        self.remove(Selection(Kind.OBSTACLE, id))

    def _add(self, kind: Kind, spec: Document) -> Any:
        changes, thing = scene_edits.added(self.scenario, kind, spec)
        self._edit(None, **changes)
        return thing

    def _update(self, kind: Kind, id: int, changes: dict[str, Any], drag: str | None) -> Any:
        changes, thing = scene_edits.updated(self.scenario, Selection(kind, id), changes)
        self._edit(drag, **changes)
        return thing

    def remove(self, selection: Selection) -> None:
        """Delete an observer, cover object or moving obstacle. Raises StudioError."""
        self._edit(None, **scene_edits.removed(self.scenario, selection))

    def find(self, selection: Selection) -> Any:
        """The selected part of the scenario. Raises StudioError (404)."""
        return scene_edits.find(self.scenario, selection)

    def select(self, selection: Selection | None) -> None:
        if selection is not None:
            self.find(selection)
        if selection != self.selection:
            self.selection = selection
            self.tell(Change.SELECTED)

    # the mission

    def _load(self, playing: bool = False) -> None:
        settings = self.method, self.seed, self.perception
        self._drive.load(self.scenario, self.scenario_id, *settings, playing, self.weights)

    def play(self) -> None:
        """Drive; a mission that is over starts again."""
        if self.status.final:
            self._load(playing=True)
            return
        self._drive.worker.play(True)
        self._drive.become(Status.RUNNING)

    def pause(self) -> None:
        if self.status is Status.RUNNING:
            self._drive.worker.play(False)
            self._drive.become(Status.PAUSED)

    def step(self) -> None:
        """One control tick, then pause."""
        if self.status.final:
            raise StudioError("the mission is over: set a new goal or reset", 409)
        self._drive.worker.step()
        self._drive.become(Status.PAUSED)

    def reset(self) -> None:
        """Back to the start of the scenario as it is now."""
        self._load()

    def stop(self) -> None:
        """End the mission where the robot is."""
        if not self.status.final:
            self._drive.worker.stop()

    def set_pose(self, x: float, y: float, yaw_deg: float) -> None:
        """Put the robot somewhere on the ground."""
        place = scene_edits.validated(Start, {"x": x, "y": y, "yaw": yaw_deg})
        yaw = math.radians(place.yaw)
        reason = why_not_standing(self.heightmap, self.scenario.cover, place.x, place.y, yaw)
        if reason:
            raise StudioError(f"the robot's place {reason}")
        self._drive.worker.set_pose(place.x, place.y, yaw)

    def set_method(self, name: str, weights: Path | None = None) -> None:
        """Plan with another method from now on, the learned one with weights of a training where given."""
        try:
            method, _ = with_motion(name)
        except ValueError as error:
            raise StudioError(str(error), 404) from None
        if method not in METHODS:
            raise StudioError(f"there is no method {name!r:.40}; choose one of {', '.join(METHODS)}", 404)
        self.method, self.weights = name, weights
        self._drive.worker.set_method(name, weights)
        self.tell(Change.SETTINGS)

    def set_perception(self, mode: str) -> None:
        if mode not in set(Perception):
            raise StudioError(f"there is no perception {mode!r:.40}; choose one of {', '.join(Perception)}")
        self.perception = Perception(mode)
        self._drive.worker.set_perception(self.perception)
        self.tell(Change.SETTINGS)

    def set_speed(self, factor: float) -> None:
        """Simulated seconds a second, 1/8 to 8."""
        low, high = SPEEDS
        if not low <= factor <= high:
            raise StudioError(f"speed must be {low:g} to {high:g}, got {factor:g}")
        self.speed = float(factor)
        self._drive.worker.set_speed(self.speed)
        self.tell(Change.SETTINGS)

    def set_seed(self, seed: int) -> None:
        """The seed of sensors and noise; a mission that has begun keeps its own until the next reset."""
        if not 0 <= seed < 2**63:
            raise StudioError(f"seed must be 0 to {2**63 - 1}, got {seed}")
        self.seed = int(seed)
        if self.status is Status.IDLE:
            self._load()
        self.tell(Change.SETTINGS)

    def off_the_map(self, x: float, y: float) -> str | None:
        """Why a point is not on this map, or None where it is."""
        return None if self.heightmap.contains(x, y) else off_the_map(self.heightmap, x, y)
