"""What the studio says of itself: the mission document, and the socket that sends it as it changes.

At most ten messages a second. A change that a person made goes out at once; frames, and the pictures that
follow a change, leave room for that. A slow reader gets the newest state and none of those between; one that
stops reading is closed.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections import Counter, deque
from dataclasses import asdict
from enum import IntEnum
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect

from app.changes import Change
from app.sockets import close, first_to_end
from app.studio import Studio
from planner.frames import Exposure, Frame, Watch
from scenes.pose import Pose

WINDOW_S = 1.05  # a little over a second, so that ten sent within a second arrive as ten at most
MOST_IN_WINDOW = 10
GAP_S = 0.125
DRAG_GAP_S = 0.2  # edits that follow each other sooner belong to one movement of a hand
STALL_S = 10.0


def mission_document(studio: Studio) -> dict[str, Any]:
    """The present mission as `GET /api/mission` gives it: metres, seconds, degrees."""
    frame = studio.frame
    return {
        "status": studio.status.value,
        "time_s": _number(frame.time_s) if frame is not None else 0.0,
        "method": studio.method,
        "policy": None if studio.weights is None else studio.weights.stem,
        "perception": studio.perception.value,
        "speed": studio.speed,
        "pose": _pose(studio, frame),
        "goal": {"x": _number(studio.scenario.goal.x), "y": _number(studio.scenario.goal.y)},
        "exposure": _exposure(studio, frame),
        "cover": _cover(frame),
        "error": studio.error,
    }


def telemetry_document(studio: Studio, revisions: Revisions) -> dict[str, Any]:
    """One message of `/api/stream`: the mission document and what a page shows around it."""
    selection = studio.selection
    return mission_document(studio) | {
        "message": studio.message,
        "real_factor": _number(studio.real_factor, 2),
        "seed": studio.seed,
        "scenario": {"id": studio.scenario_id, "name": studio.scenario.name},
        "dirty": studio.dirty,
        "can_undo": studio.can_undo,
        "can_redo": studio.can_redo,
        "selection": None if selection is None else {"kind": selection.kind, "id": selection.id},
        "revision": revisions.counts(),
        "edits": studio.edits,
        "overlay": None if studio.overlay is None else asdict(studio.overlay),
        "metrics": _metrics(studio.frame),
    }


def _number(value: float, digits: int = 3) -> float | None:
    """Rounded for the wire; None where JSON has no word for it."""
    value = float(value)
    return round(value, digits) if math.isfinite(value) else None


def _pose(studio: Studio, frame: Frame | None) -> dict[str, float | None]:
    if frame is not None:
        pose = frame.pose
    else:
        start = studio.scenario.start
        ground = float(studio.heightmap.height_at(start.x, start.y))
        pose = Pose(start.x, start.y, ground, yaw=math.radians(start.yaw))
    place = {axis: _number(getattr(pose, axis)) for axis in ("x", "y", "z")}
    return place | {turn: _number(math.degrees(getattr(pose, turn)), 2) for turn in ("roll", "pitch", "yaw")}


def _exposure(studio: Studio, frame: Frame | None) -> dict[str, Any]:
    """How much of the robot is seen now, and the drive's totals, by all observers and by each."""
    now = frame.exposure if frame is not None else Exposure()
    watches = {watch.observer_id: watch for watch in now.watches}
    percept = frame.percept if frame is not None else None
    found = set(percept.known_observers) if percept is not None else set()
    expected = now.expected_detection_s
    return _totals(now) | {
        "concealed_fraction": _number(now.concealed_fraction, 4),
        "expected_detection_s": None if expected is None else _number(expected, 2),
        "observers": [
            {"id": observer.id, "known": observer.known or observer.id in found}
            | _totals(watches.get(observer.id, Watch(observer.id)))
            for observer in studio.scenario.observers
        ],
    }


def _totals(seen: Exposure | Watch) -> dict[str, float | None]:
    return {
        "fraction": _number(seen.fraction, 4),
        "exposed_s": _number(seen.exposed_s, 2),
        "exposure_fraction": _number(seen.exposure_fraction, 4),
        "longest_exposure_s": _number(seen.longest_exposure_s, 2),
        "detection_probability": _number(seen.detection_probability, 5),
    }


def _cover(frame: Frame | None) -> dict[str, Any]:
    if frame is None:
        return {"in_cover": False, "fraction": 0.0, "chosen": None}
    return {
        "in_cover": frame.in_cover,
        "fraction": _number(frame.metrics.cover_fraction),
        "chosen": frame.decision.cover_id if frame.decision is not None else None,
    }


def _metrics(frame: Frame | None) -> dict[str, Any] | None:
    if frame is None:
        return None
    totals = frame.metrics
    return {
        "tick": frame.tick,
        "goal_distance_m": _number(math.hypot(frame.goal[0] - frame.pose.x, frame.goal[1] - frame.pose.y)),
        "v": _number(frame.twist.v),
        "w_deg": _number(math.degrees(frame.twist.w), 1),
        "trajectory_length_m": _number(totals.trajectory_length_m, 2),
        "collisions": totals.collisions,
        "max_roll_deg": _number(math.degrees(totals.max_roll), 1),
        "max_pitch_deg": _number(math.degrees(totals.max_pitch), 1),
        "cover_fraction": _number(totals.cover_fraction),
        "elevation_gradient_m": _number(totals.elevation_gradient_m, 2),
        "planner_ms": _number(frame.planner_ms, 1),
    }


class Revisions:
    """Counts changes by kind, so that a page knows what to fetch again."""

    def __init__(self, studio: Studio) -> None:
        self._counts: Counter[Change] = Counter()
        studio.subscribe(self._count)

    def _count(self, change: Change) -> None:
        self._counts[change] += 1

    def counts(self) -> dict[str, int]:
        told = (change for change in Change if change is not Change.FRAME)
        return {change.value: self._counts[change] for change in told}


class Turn(IntEnum):
    """What a message tells of. It may go while fewer than so many fell within the window, so that there is
    room for what matters more."""

    FRAME = 7
    PICTURE = 9
    CHANGE = MOST_IN_WINDOW


class Pace:
    """When the next message may go: at most MOST_IN_WINDOW in any window, frames and pictures apart."""

    def __init__(self) -> None:
        self._sent: deque[float] = deque(maxlen=MOST_IN_WINDOW)

    def sent(self, now: float) -> None:
        self._sent.append(now)

    def earliest(self, turn: Turn) -> float:
        """The earliest time, on the clock that `sent` is told, for a message that tells of `turn`."""
        due = self._after(turn, WINDOW_S)
        return due if turn is Turn.CHANGE else max(due, self._after(1, GAP_S))

    def _after(self, back: int, gap: float) -> float:
        return self._sent[-back] + gap if len(self._sent) >= back else -math.inf


class _Listener:
    """One reader's pending news: whether there are any, and the most urgent of them."""

    def __init__(self, studio: Studio) -> None:
        self._studio = studio
        self._edited_at = -math.inf
        self.turn = Turn.FRAME
        self.news = asyncio.Event()
        self.raised = asyncio.Event()

    def hear(self, change: Change) -> None:
        turn = self._turn_of(change)
        if turn > self.turn:
            self.turn = turn
            self.raised.set()
        self.news.set()

    def _turn_of(self, change: Change) -> Turn:
        """A drag's many edits and their pictures may wait for their turn, or they would use up the turns of
        what ends it."""
        match change:
            case Change.FRAME | Change.EXPOSURE | Change.TRAINING:
                return Turn.FRAME
            case Change.OVERLAY:
                overlay = self._studio.overlay
                awaited = overlay is not None and overlay.edits == self._studio.edits
                return Turn.PICTURE if awaited else Turn.FRAME
            case Change.EDITED:
                before, self._edited_at = self._edited_at, time.monotonic()
                return Turn.CHANGE if self._edited_at - before > DRAG_GAP_S else Turn.FRAME
        return Turn.CHANGE

    def heard(self) -> None:
        self.turn = Turn.FRAME
        self.news.clear()
        self.raised.clear()


async def stream(websocket: WebSocket, studio: Studio, revisions: Revisions) -> None:
    """Serve one reader until it goes: the present state at once, then every change at its pace."""
    await websocket.accept()
    listener = _Listener(studio)
    unsubscribe = studio.subscribe(listener.hear)
    try:
        await first_to_end(_tell(websocket, studio, revisions, listener), _until_gone(websocket))
    except TimeoutError:
        await close(websocket, 1008, "the reader has stopped reading")
    except (WebSocketDisconnect, RuntimeError):
        pass  # the reader has gone
    finally:
        unsubscribe()


async def _tell(websocket: WebSocket, studio: Studio, revisions: Revisions, listener: _Listener) -> None:
    pace = Pace()
    while True:
        listener.heard()
        text = json.dumps(telemetry_document(studio, revisions), ensure_ascii=False, allow_nan=False)
        async with asyncio.timeout(STALL_S):
            await websocket.send_text(text)
        pace.sent(time.monotonic())
        await listener.news.wait()
        await _until_due(pace, listener)


async def _until_due(pace: Pace, listener: _Listener) -> None:
    """Wait for the turn of what has changed; more urgent news meanwhile come sooner."""
    while (wait := pace.earliest(listener.turn) - time.monotonic()) > 0.0:
        listener.raised.clear()
        try:
            await asyncio.wait_for(listener.raised.wait(), wait)
        except TimeoutError:
            return


async def _until_gone(websocket: WebSocket) -> None:
    """Readers have nothing to say; what they send is dropped."""
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass
