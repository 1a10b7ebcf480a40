"""The scenario document: what it takes, what it refuses and how it says so, and that files are safe."""

from __future__ import annotations

import json
import math
import time
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from small import document, scenario

from scenes.catalogue import CATALOGUE, CoverKind
from scenes.scenario import (
    MAX_COVER,
    MAX_FILE_BYTES,
    CoverObject,
    CoverSpec,
    MovingObstacle,
    Observer,
    Patrol,
    Point,
    Scenario,
    ScenarioError,
    write_atomically,
)

coordinates = st.floats(-10.0, 10.0)
patrols = st.builds(
    Patrol,
    waypoints=st.lists(st.builds(Point, x=coordinates, y=coordinates), min_size=1, max_size=4).map(tuple),
    speed=st.floats(0.05, 20.0),
    loop=st.booleans(),
)
observers = st.builds(
    Observer,
    id=st.integers(1, 1000),
    x=coordinates,
    y=coordinates,
    yaw=st.floats(-360.0, 360.0),
    patrol=st.none() | patrols,
    name=st.none() | st.from_regex(r"[^\x00-\x1f<>\ud800-\udfff]{1,80}", fullmatch=True),
    eye_height=st.floats(0.0, 100.0),
    fov_horizontal=st.floats(0.0, 360.0),
    known=st.booleans(),
)
bushes = st.builds(
    CoverObject,
    id=st.integers(1, 1000),
    kind=st.sampled_from(CoverKind),
    x=coordinates,
    y=st.floats(5.0, 10.0),
    length=st.floats(0.05, 1.0),
    width=st.floats(0.05, 1.0),
)
walkers = st.builds(
    MovingObstacle,
    id=st.integers(1, 1000),
    kind=st.sampled_from(["person", "vehicle"]),
    x=coordinates,
    y=coordinates,
    patrol=st.none() | patrols,
).filter(lambda walker: math.dist((walker.x, walker.y), (-6.0, 0.0)) > 3.0)  # off the robot


def distinct(things: st.SearchStrategy) -> st.SearchStrategy:
    return st.lists(things, max_size=4, unique_by=lambda thing: thing.id).map(tuple)


@given(cover=distinct(bushes), observers=distinct(observers), obstacles=distinct(walkers), data=st.data())
def test_what_is_written_reads_back_the_same(cover, observers, obstacles, data):
    heights = [[data.draw(st.floats(-9000.0, 9000.0))] + [1.25] * 40 for _ in range(41)]
    terrain = document()["terrain"] | {"heights": heights}
    before = scenario(terrain=terrain).revised(cover=cover, observers=observers, obstacles=obstacles)
    text = before.to_json()
    after = Scenario.model_validate_json(text)
    assert after.to_json() == text
    assert (after.cover, after.observers, after.obstacles) == (cover, observers, obstacles)
    assert (after.terrain.heights == before.terrain.heights).all()


def test_a_map_row_is_a_line_of_its_own_so_that_a_diff_shows_what_changed():
    lines = scenario().to_json().splitlines()
    assert sum(line.startswith("   [0.0,") for line in lines) == 41


def test_heights_are_kept_to_the_millimetre_and_cannot_be_written_to():
    terrain = document()["terrain"] | {"heights": [[0.12345] * 41] * 41}
    heights = scenario(terrain=terrain).terrain.heights
    assert heights[0, 0] == 0.123
    with pytest.raises(ValueError, match="read-only"):
        heights[0, 0] = 1.0


@pytest.mark.parametrize("kind", CoverKind)
def test_a_side_that_is_left_out_or_null_takes_the_class_s_usual_size(kind):
    entry = CATALOGUE[kind]
    for sides in ({}, {"length": None, "width": None, "height": None}):
        thing = CoverSpec.model_validate({"kind": kind.value, "x": 0.0, "y": 0.0} | sides)
        assert thing.size == (entry.length.usual, entry.width.usual, entry.height.usual)


@pytest.fixture
def check_refused(tmp_path):
    """Loading the text fails with one short line that begins with the place and holds the remedy."""

    def check(text: str, place: str, remedy: str) -> None:
        path = tmp_path / "scenario.json"
        path.write_text(text, "utf-8")
        with pytest.raises(ScenarioError) as caught:
            Scenario.load(path)
        message = str(caught.value)
        assert message.startswith(f"{path}: {place}") and remedy in message
        assert len(message) < len(str(path)) + 200 and "\n" not in message

    return check


NOT_A_NUMBER = [
    ("NaN", "finite"),
    ("1e400", "finite"),
    ("-Infinity", "finite"),
    ("true", "number"),
    ('"3"', "number"),
    ("null", "number"),
    ("[1]", "number"),
    ("1e30", "or equal to"),
]


@pytest.mark.parametrize(("literal", "reason"), NOT_A_NUMBER)
@pytest.mark.parametrize(("field", "before"), [("goal.x", '"goal": {"x": 6.0'), ("start.yaw", '"yaw": 0.0')])
def test_a_number_must_be_a_finite_bounded_number(check_refused, field, before, literal, reason):
    text = json.dumps(document()).replace(before, before.rsplit(" ", 1)[0] + " " + literal)
    assert literal in text
    check_refused(text, field + ": ", reason)


@pytest.mark.parametrize("literal", ["NaN", "1e400", "9001", "true", '"3"', "null", "[]", "1" + "0" * 400])
def test_a_height_must_be_a_finite_bounded_number(check_refused, literal):
    text = json.dumps(document()).replace('"heights": [[0.0', f'"heights": [[{literal}')
    check_refused(text, "terrain.heights: ", "")


def cover_with(**fields: Any) -> dict[str, Any]:
    return {"cover": [{"id": 7, "kind": "tree", "x": 1.0, "y": 5.0} | fields]}


def watched_along(*waypoints: dict[str, float]) -> dict[str, Any]:
    return {"observers": [{"id": 1, "x": 0.0, "y": 5.0, "patrol": {"waypoints": list(waypoints)}}]}


def terrain_with(**fields: Any) -> dict[str, Any]:
    return {"terrain": document()["terrain"] | fields}


@pytest.mark.parametrize(
    ("changes", "place", "remedy"),
    [
        ({"colour": "red"}, "colour: ", "not a field that is known"),
        ({"version": 2}, "version: ", "must be 1"),
        ({"name": "<b>"}, "name: ", "pattern"),
        ({"goal": {"y": 0.0}}, "goal.x: ", "missing"),
        ({"goal": {"x": 6.0, "y": 10.5}}, "goal is off the map", "y within -10 to 10"),
        ({"start": {"x": -60.0, "y": 0.0}}, "start is off the map", "x must lie within -10 to 10"),
        (cover_with(kind="house", x=6.0, y=1.0), "goal is inside a house 7", ""),
        (cover_with(kind="bush", x=6.0, y=0.8), "goal is 0.21 m from bush 7", "needs 0.34 m"),
        (cover_with(kind="dragon"), "cover[0].kind: ", "'tree', 'bush'"),
        (cover_with(height=0.0), "cover[0].height: ", "0.05"),
        (cover_with(x=10.5), "cover[0] is off the map", "x must lie within -10 to 10"),
        (cover_with(id=0), "cover[0].id: ", "equal to 1"),
        ({"cover": cover_with()["cover"] * 2}, "cover[1].id 7 is used twice", ""),
        (watched_along({"x": 0.0, "y": 99.0}), "observers[0] is off the map", "within -10 to 10"),
        (watched_along(), "observers[0].patrol.waypoints: ", "at least 1"),
        (watched_along(*[{"x": 0.0, "y": 0.0}] * 101), "observers[0].patrol.waypoints: ", "at most 100"),
        (terrain_with(heights=[], surface=[]), "terrain.heights: the map is 0 × 0", "8 to 1024"),
        (terrain_with(heights=[[0.0]] * 50_000), "terrain.heights: the map is 50000 × 1", "8 to 1024"),
        (terrain_with(heights=[[0.0] * 41] * 40 + [[0.0]]), "terrain.heights: row 40", "41 numbers"),
        (terrain_with(heights="flat"), "terrain.heights: ", "rows of numbers"),
        (terrain_with(resolution=0.0), "terrain.resolution: ", "0.05"),
        (terrain_with(surface=["g" * 41] * 40), "terrain: surface has 40 rows", "heights has 41"),
        (terrain_with(surface=["g" * 40] * 41), "terrain: surface row 0 has 40 letters", "not 41"),
        (terrain_with(surface=["ä" * 41] * 41), "terrain: surface row 0", "agmrstvw"),
        (terrain_with(quality=["?" * 41] * 41), "terrain: quality row 0", ".ix"),
        (terrain_with(surface=["w" * 41] * 41), "start is in water", ""),
        ({"start": {"x": -9.5, "y": 0.0, "yaw": 20.0}}, "start is 0.50 m from the map's edge", "0.60 m"),
        ({"goal": {"x": 9.9, "y": 0.0}}, "goal is 0.10 m from the map's edge", "needs 0.3"),
        (
            {"cover": [{"id": 3, "kind": "rock", "x": -6.0, "y": 1.4, "length": 2.0, "width": 2.0}],
             "start": {"x": -6.0, "y": 0.0, "yaw": 60.0}},
            "start is 0.50 m from rock 3", "0.60 m",
        ),
        (
            {"obstacles": [{"id": 1, "kind": "vehicle", "x": -4.0, "y": 0.0}]},
            "obstacles[0] begins where the robot starts", "move one of them",
        ),
        (terrain_with(quality=["x" * 41] * 41), "start is where the survey has no data", ""),
        (terrain_with(source={"kind": "moon"}), "terrain.source: ", "'generated', 'survey'"),
    ],
)
def test_an_unusable_document_is_refused_with_its_place_and_what_would_be_right(
    check_refused, changes, place, remedy
):
    check_refused(json.dumps(document() | changes), place, remedy)


@pytest.mark.parametrize("field", ["name", "terrain", "start", "goal"])
def test_a_missing_field_is_named(check_refused, field):
    fields = document()
    del fields[field]
    check_refused(json.dumps(fields), f"{field}: ", "is missing")


@pytest.mark.parametrize("text", ["", "hello", "[]", "null", "[" * 10_000, '{"name": "half', "\0" * 64])
def test_what_is_no_document_is_refused_in_one_line(check_refused, text):
    check_refused(text, "", "")


def test_the_name_of_an_unknown_field_cannot_flood_the_message(check_refused):
    check_refused(json.dumps(document() | {"a\nb" * 10_000: 1}), "a b", "not a field")


def test_a_crowd_of_objects_is_refused_before_it_is_looked_at():
    crowd = [{"id": 1, "kind": "tree", "x": 1.0, "y": 5.0}] * 1_000_000
    began = time.process_time()
    with pytest.raises(ValueError, match="at most 2000"):
        Scenario.model_validate(document(cover=crowd))
    assert time.process_time() - began < 5.0
    assert MAX_COVER == 2000


def test_a_file_that_is_too_large_is_refused_unread(tmp_path):
    path = tmp_path / "large.json"
    with path.open("wb") as stream:
        stream.truncate(MAX_FILE_BYTES + 1)
    with pytest.raises(ScenarioError, match="larger than 16 MiB"):
        Scenario.load(path)


@pytest.mark.parametrize(("name", "content"), [("missing.json", None), ("binary.json", b"\xff\xfe\x00")])
def test_a_file_that_cannot_be_read_is_named(tmp_path, name, content):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ScenarioError, match=f"{name}: cannot be read"):
        Scenario.load(tmp_path / name)


def test_a_folder_is_no_scenario(tmp_path):
    with pytest.raises(ScenarioError, match="cannot be read"):
        Scenario.load(tmp_path)


def test_save_and_load(tmp_path):
    path = tmp_path / "new folder" / "field.json"
    scenario().save(path)
    assert Scenario.load(path) == scenario()


def test_scenarios_are_equal_by_what_they_hold():
    one, other = scenario(), scenario()
    assert one == other and hash(one) == hash(other)
    higher = one.revised(terrain=one.terrain.model_copy(update={"heights": one.terrain.heights + 1.0}))
    assert higher != one and one.revised(name="another") != one


def test_a_save_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "field.json"
    scenario().save(path)
    before = path.read_bytes()

    def disk_full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("scenes.document.os.fsync", disk_full)
    with pytest.raises(OSError, match="No space"):
        write_atomically(path, "half a docu")
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_revision_is_checked_like_a_file():
    field = scenario()
    assert field.revised(goal=Point(x=3.0, y=3.0)).goal == Point(x=3.0, y=3.0)
    with pytest.raises(ScenarioError, match="goal is off the map"):
        field.revised(goal=Point(x=30.0, y=3.0))


def test_a_person_may_stand_where_the_robot_may_not():
    """Observers sit in houses and wade; only the robot's own places are held to what a robot can do."""
    house = CoverObject(id=1, kind=CoverKind.HOUSE, x=0.0, y=5.0)
    field = scenario().revised(cover=(house,), observers=(Observer(id=1, x=0.0, y=5.0),))
    assert field.observers[0].x == 0.0


def test_a_walker_without_a_beat_stands_still():
    watcher = Observer(id=1, x=1.0, y=2.0, yaw=90.0)
    assert watcher.pose_at(100.0) == pytest.approx((1.0, 2.0, 1.5707963))


def test_a_person_is_round_and_a_vehicle_long():
    person = MovingObstacle.model_validate({"id": 1, "kind": "person", "x": 1.0, "y": 2.0})
    vehicle = MovingObstacle.model_validate({"id": 2, "kind": "vehicle", "x": 1.0, "y": 2.0})
    assert person.footprint_at(0.0).round and not vehicle.footprint_at(0.0).round
    assert vehicle.footprint_at(0.0).length == vehicle.size[0]
