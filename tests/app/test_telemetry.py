"""The telemetry socket: how often, how soon, and what happens to readers that are slow."""

import asyncio
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from served import BEARER, OPEN_ID, application, browser, silent_studio

from app import telemetry
from app.changes import Change, Kind, Selection
from app.mission_process import Progress
from app.telemetry import (
    GAP_S,
    MOST_IN_WINDOW,
    Pace,
    Revisions,
    Turn,
    mission_document,
    stream,
    telemetry_document,
)
from planner.frames import Exposure, Frame, Metrics, Status, Watch
from scenes.pose import Pose, Twist
from scenes.scenario import ObserverSpec


@pytest.fixture
def studio(tmp_path, meadow):
    return silent_studio(tmp_path, meadow)


def frame(tick: int = 1, **changes) -> Frame:
    fields = {
        "tick": tick,
        "time_s": 0.1 * tick,
        "status": Status.RUNNING,
        "pose": Pose(1.0, 2.0, 0.5, 0.1, -0.2, math.pi / 2),
        "twist": Twist(0.5, 0.25),
        "wheel_angles": (0.0,) * 4,
        "goal": (3.0, 0.0),
        "percept": None,
        "decision": None,
        "metrics": Metrics(cover_fraction=0.25),
        "in_cover": True,
    }
    return Frame(**(fields | changes))


def test_the_document_follows_the_newest_frame(studio):
    studio._drive.frame = frame(3)
    document = mission_document(studio)
    assert document["time_s"] == 0.3
    assert document["pose"] == {"x": 1.0, "y": 2.0, "z": 0.5, "roll": 5.73, "pitch": -11.46, "yaw": 90.0}
    assert document["cover"] == {"in_cover": True, "fraction": 0.25, "chosen": None}


def test_the_document_says_who_sees_the_robot_and_how_long_it_was_seen(studio):
    near, far = (studio.add_observer(ObserverSpec(x=x, y=6.0)) for x in (1.0, 5.0))
    assert mission_document(studio)["exposure"]["observers"][-1]["exposed_s"] == 0.0
    seen = Watch(near.id, 0.5, 1.25, 0.4, 0.8, 0.625)
    exposure = Exposure(0.5, 1.25, 0.4, 0.8, 0.6, 0.625, 1.5, (seen,))
    studio._drive.frame = frame(exposure=exposure)
    document = mission_document(studio)["exposure"]
    totals = {
        "fraction": 0.5,
        "exposed_s": 1.25,
        "exposure_fraction": 0.4,
        "longest_exposure_s": 0.8,
        "detection_probability": 0.625,
    }
    assert document.items() >= totals.items()
    assert document["concealed_fraction"] == 0.6 and document["expected_detection_s"] == 1.5
    watched, unwatched = document["observers"][-2:]
    assert watched == {"id": near.id, "known": True} | totals
    assert unwatched == {"id": far.id, "known": True} | dict.fromkeys(totals, 0.0)


def test_a_number_that_json_has_no_word_for_is_null(studio):
    studio._drive.frame = frame(pose=Pose(math.nan, 0.0, math.inf))
    assert mission_document(studio)["pose"] == {
        "x": None,
        "y": 0.0,
        "z": None,
        "roll": 0.0,
        "pitch": 0.0,
        "yaw": 0.0,
    }


def test_the_stream_says_what_a_page_shows_around_the_mission(studio):
    revisions = Revisions(studio)
    studio.select(Selection(Kind.OBSERVER, 1))
    studio.add_observer(ObserverSpec(x=1.0, y=6.0))
    studio._drive.frame = frame()
    document = telemetry_document(studio, revisions)
    assert document.items() >= mission_document(studio).items()
    assert document["scenario"] == {"id": OPEN_ID, "name": "Test meadow"}
    assert document["dirty"] and document["can_undo"] and not document["can_redo"]
    assert document["selection"] == {"kind": "observer", "id": 1}
    assert document["revision"]["edited"] == 1 and document["revision"]["selected"] == 1
    assert document["metrics"]["goal_distance_m"] == pytest.approx(2.828)
    assert document["metrics"]["v"] == 0.5


@given(st.lists(st.tuples(st.floats(0.0, 0.3), st.sampled_from(Turn)), min_size=1, max_size=200))
def test_no_second_holds_more_than_ten_messages(arrivals):
    """Whatever mix of frames and changes wants to go out, at whatever times."""
    pace, now, sent = Pace(), 0.0, []
    for gap, turn in arrivals:
        now = max(now + gap, pace.earliest(turn))
        pace.sent(now)
        sent.append(now)
    for first, last in zip(sent, sent[MOST_IN_WINDOW:], strict=False):
        assert last - first > 1.0


def test_frames_leave_room_for_what_people_change():
    """While frames come without pause, three changes a second go out at once."""
    pace, now = Pace(), 0.0
    for _ in range(50):
        now = max(now, pace.earliest(Turn.FRAME))
        pace.sent(now)
    for _ in range(3):
        assert pace.earliest(Turn.CHANGE) <= now
        pace.sent(now)
    assert pace.earliest(Turn.CHANGE) > now


@pytest.mark.parametrize("changes_per_second", [1, 2, 3, 4])
def test_whoever_changes_things_again_and_again_waits_for_none(changes_per_second):
    """Four changes a second, each followed by its picture, among frames without pause."""
    pace, period = Pace(), 1.0 / changes_per_second
    for change in range(40):
        moment = change * period
        assert pace.earliest(Turn.CHANGE) <= moment
        pace.sent(moment)
        if (picture := max(moment + 0.02, pace.earliest(Turn.PICTURE))) < moment + period:
            pace.sent(picture)
            moment = picture
        while (frame := max(moment, pace.earliest(Turn.FRAME))) < (change + 1) * period:
            pace.sent(frame)
            moment = frame


@given(st.floats(0.02, 0.1), st.integers(1, 100))
def test_the_picture_that_ends_a_drag_waits_for_no_more_than_one_gap(period, moves):
    """However many pictures the drag has had before it, and however quickly they came."""
    pace = Pace()
    pace.sent(0.0)
    for move in range(1, moves + 1):
        if pace.earliest(Turn.PICTURE) <= move * period:
            pace.sent(move * period)
    assert pace.earliest(Turn.PICTURE) <= moves * period + GAP_S


def test_words_that_change_with_every_frame_leave_the_turns_to_what_people_do(studio):
    told = []
    studio.subscribe(told.append)
    for tick, words in ((1, "starting"), (2, "3.0 m to go"), (3, "2.9 m to go")):
        report = Progress(0, 0, Status.RUNNING, frame(tick, message=words), (), 1.0, None)
        studio._drive._follow(report, current=True)
        assert studio.message == words
    assert told == [Change.FRAME, Change.STATUS, Change.FRAME, Change.FRAME]


def test_a_reader_gets_the_present_state_at_once_and_then_each_change(studio):
    client = browser(application(studio), **BEARER)
    with client.websocket_connect("ws://127.0.0.1:8000/api/stream") as socket:
        assert socket.receive_json()["goal"] == {"x": 3.0, "y": 0.0}
        client.put("/api/mission/goal", json={"x": 2.0, "y": 1.0})
        assert socket.receive_json()["goal"] == {"x": 2.0, "y": 1.0}
        socket.send_text("readers have nothing to say")
        client.post("/api/mission/start")
        assert socket.receive_json()["status"] == "running"
    with client.websocket_connect("ws://127.0.0.1:8000/api/stream") as again:
        assert again.receive_json()["status"] == "running"
    assert client.get("/api/mission").status_code == 200


class Reader:
    """A websocket as the stream sees it, whose reader takes messages only when told to."""

    def __init__(self) -> None:
        self.taken: list[str] = []
        self.ready = asyncio.Event()
        self.closed: int | None = None

    async def accept(self) -> None:
        self.ready.set()

    async def send_text(self, text: str) -> None:
        await self.ready.wait()
        self.taken.append(text)

    async def receive(self) -> dict:
        await asyncio.Event().wait()
        return {}

    async def close(self, code: int, reason: str) -> None:
        self.closed = code


def test_a_slow_reader_gets_the_newest_and_none_between(studio, monkeypatch):
    monkeypatch.setattr(telemetry, "GAP_S", 0.0)

    async def run() -> Reader:
        reader = Reader()
        serving = asyncio.create_task(stream(reader, studio, Revisions(studio)))
        await settle()
        reader.ready.clear()
        for tick in range(1, 40):
            studio._drive.frame = frame(tick)
            studio.tell(Change.FRAME)
            await settle()
        reader.ready.set()
        await settle()
        studio.tell(Change.FRAME)
        await settle()
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)
        return reader

    reader = asyncio.run(run())
    assert len(reader.taken) <= 4 and '"tick": 39' in reader.taken[-1]


def test_a_reader_that_stops_reading_is_closed_and_forgotten(studio, monkeypatch):
    monkeypatch.setattr(telemetry, "STALL_S", 0.01)

    async def run() -> Reader:
        reader = Reader()
        listeners = len(studio._listeners)
        serving = asyncio.create_task(stream(reader, studio, Revisions(studio)))
        await settle()
        reader.ready.clear()
        studio.tell(Change.EDITED)
        await asyncio.wait_for(serving, 10.0)
        assert len(studio._listeners) == listeners + 1  # the revisions' own
        return reader

    assert asyncio.run(run()).closed == 1008


async def settle() -> None:
    for _ in range(20):
        await asyncio.sleep(0)
