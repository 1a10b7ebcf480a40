"""The file of an evaluation: what was written is read; what comes from elsewhere is not believed."""

import json
import sqlite3
import zlib
from contextlib import closing

import pytest
from evaluations import drive, drives, results_file

from app.results_store import ResultsError, ResultsFile, write
from planner.evaluation_table import tabulate


@pytest.fixture
def path(tmp_path):
    return results_file(tmp_path / "results.sqlite")


def changed(path, statement, *values):
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(statement, values)


def test_the_table_of_a_file_is_that_of_its_missions(path):
    file = ResultsFile(path)
    assert file.title == "two methods"
    assert tabulate(file.missions()) == tabulate(drives())


def test_ways_and_scenes_are_kept_and_a_scene_once(path):
    file = ResultsFile(path)
    missions = file.missions()
    assert all(mission["drawn"] for mission in missions)
    way = file.trajectory(missions[0]["id"])
    assert len(way.time_s) == 21 and way.duration_s == 10.0
    assert file.recipe(missions[0]["id"]) == drive(0, "dwa")["scene"]
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("SELECT count(*) FROM scenes").fetchone() == (1,)


def test_errors_and_results_of_old_have_no_way(tmp_path):
    broken = {"terrain": "low", "method": "dwa", "seed": 1, "perception": "lidar", "goal_distance": 12.0}
    broken |= {"status": "error", "success": False, "reason": "its worker process was killed"}
    file = ResultsFile(results_file(tmp_path / "a.sqlite", [broken]))
    (mission,) = file.missions()
    assert not mission["drawn"] and mission["reason"] == broken["reason"]
    with pytest.raises(LookupError, match="whose way is known"):
        file.trajectory(mission["id"])


def test_writing_replaces_whole_or_not_at_all(path):
    before = path.read_bytes()
    with pytest.raises(ValueError):
        write(path, [drive(0, "dwa", exposed_s=float("nan"))], "broken")
    assert path.read_bytes() == before
    assert [entry.name for entry in path.parent.iterdir()] == ["results.sqlite"]


@pytest.mark.parametrize("content", [b"", b"hello", b"SQLite format 3\0" + bytes(200)])
def test_another_file_is_refused(tmp_path, content):
    path = tmp_path / "x.sqlite"
    path.write_bytes(content)
    with pytest.raises(ResultsError, match=r"x\.sqlite"):
        ResultsFile(path)


def test_another_database_is_refused(tmp_path):
    path = tmp_path / "x.sqlite"
    changed(path, "CREATE TABLE runs (id INTEGER)")
    with pytest.raises(ResultsError, match="not an evaluation"):
        ResultsFile(path)


def test_a_view_that_poses_as_a_table_is_refused(path):
    changed(path, "ALTER TABLE missions RENAME TO real")
    changed(path, "CREATE VIEW missions AS SELECT * FROM real")
    with pytest.raises(ResultsError, match="not an evaluation"):
        ResultsFile(path)


HEAD = ("terrain", "method", "seed", "perception", "goal_distance", "success")


def packed(text):
    return zlib.compress(text.encode())


@pytest.mark.parametrize(
    "summary",
    [
        b"hello",
        packed("[1"),
        packed("[]"),
        packed('{"terrain": "moon"}'),
        packed("[" * 100_000),
        zlib.compress(bytes(4 * 2**20)),
        packed('{"terrain": "normal", "seed": NaN}'),
        packed(json.dumps({name: drive(0, "dwa").get(name) for name in HEAD} | {"status": "\ud800"})),
    ],
)
def test_a_damaged_mission_is_refused(path, summary):
    changed(path, "UPDATE missions SET summary = ? WHERE id = 2", summary)
    with pytest.raises(ResultsError, match="damaged"):
        ResultsFile(path).missions()


def test_a_file_without_missions_is_refused(tmp_path):
    with pytest.raises(ResultsError, match="no mission"):
        ResultsFile(results_file(tmp_path / "a.sqlite", [])).missions()


def test_a_file_of_very_many_kinds_is_refused(tmp_path):
    far = [drive(0, "dwa") | {"goal_distance": 4.0 + 0.1 * number} for number in range(201)]
    with pytest.raises(ResultsError, match="kinds"):
        ResultsFile(results_file(tmp_path / "a.sqlite", far)).missions()


@pytest.mark.parametrize(("name", "most"), [("MOST_MISSIONS", 3), ("MOST_SUMMARIES", 900)])
def test_a_file_that_would_fill_the_memory_is_refused(path, monkeypatch, name, most):
    monkeypatch.setattr(f"app.results_store.{name}", most)
    with pytest.raises(ResultsError, match=r"more than .* evaluate them in parts"):
        ResultsFile(path).missions()


def test_of_a_mission_what_no_table_reads_is_left_in_the_file(tmp_path):
    path = results_file(tmp_path / "a.sqlite", [drive(0, "dwa") | {"padding": ["x"] * 1000}])
    (mission,) = ResultsFile(path).missions()
    assert "padding" not in mission and mission["method"] == "dwa"


def test_a_mission_of_very_many_figures_is_refused(tmp_path):
    path = results_file(tmp_path / "a.sqlite", [drive(0, "dwa") | {"padding": "x" * 70_000}])
    with pytest.raises(ResultsError, match="damaged"):
        ResultsFile(path).missions()


@pytest.mark.parametrize(
    "fields",
    [
        {"exposed_s": "much"},
        {"exposed_s": 1.7e308},
        {"execution_time_s": 10**400},
        {"shortest_s": None},
        {"bound_m": None},
        {"success": 1},
        {"status": 7},
        {"status": "a\x01b"},
        {"execution_time_s": None},
        {"method": "x" * 999},
        {"seed": 1.5},
        {"seed": -1},
        {"goal_distance": 10**400},
    ],
)
def test_figures_that_are_none_are_refused(tmp_path, fields):
    path = results_file(tmp_path / "a.sqlite", [drive(0, "dwa") | fields] if "method" not in fields else None)
    if "method" in fields:
        path = results_file(tmp_path / "a.sqlite", [drive(0, fields["method"])])
    with pytest.raises(ResultsError, match="damaged"):
        ResultsFile(path).missions()


@pytest.mark.parametrize(
    "way",
    [
        '{"x_cm": [1]}',
        '{"period_s": 0.5, "end_s": 0.0, "x_cm": [1e999], "y_cm": [0], "yaw_deg": [0], "seen_pct": [0]}',
        '{"period_s": 1e999, "end_s": 0.5, "x_cm": [1], "y_cm": [0], "yaw_deg": [0], "seen_pct": [0]}',
    ],
)
def test_a_way_that_is_none_is_refused(path, way):
    changed(path, "UPDATE missions SET trajectory = ? WHERE id = 1", packed(way))
    with pytest.raises(ResultsError, match="mission 1"):
        ResultsFile(path).trajectory(1)
