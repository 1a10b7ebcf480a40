"""The workspace: what is saved stays saved, whatever happens beside it."""

import os
import sqlite3
import zlib
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.store import FIRST_COLUMNS, FRAME_COLUMNS, ID_PATTERN, MAX_ID, Store, StoreError, UnknownEntry
from scenes.scenario import ScenarioError

SUMMARY = {"status": "reached", "success": True, "trajectory_length_m": 6.1}


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "workspace")


def test_a_saved_scenario_comes_back_as_it_was(store, meadow):
    store.save("mine", meadow)
    assert store.load("mine").to_json() == meadow.to_json()
    assert "mine" in [entry.id for entry in store.scenarios() if not entry.shipped]


def test_shipped_scenarios_are_listed_first_and_cannot_be_overwritten_or_deleted(store, meadow):
    first = store.scenarios()[0]
    assert first.shipped and first.modified is None
    with pytest.raises(UnknownEntry):
        store.save(first.id, meadow)
    with pytest.raises(UnknownEntry, match="shipped"):
        store.delete(first.id)


@pytest.mark.parametrize("bad", ["", "..", "../x", "a/b", "A", "a--b", "a" * 100, "a.json", "\x00", "-a"])
def test_an_id_never_leaves_the_folder(store, meadow, bad):
    with pytest.raises(UnknownEntry):
        store.save(bad, meadow)
    with pytest.raises(UnknownEntry):
        store.load(bad)


@pytest.fixture(scope="module")
def empty_store(tmp_path_factory) -> Store:
    return Store(tmp_path_factory.mktemp("ids"))


@given(name=st.text(max_size=120))
def test_every_name_gives_a_usable_id(empty_store, name):
    made = empty_store.new_id(name)
    assert ID_PATTERN.fullmatch(made) and len(made) <= MAX_ID


def test_new_ids_do_not_collide(store, meadow):
    store.save(store.new_id("Hill"), meadow)
    assert store.new_id("Hill") == "hill-2"


def test_a_failed_save_leaves_the_old_file_and_no_rubbish(store, meadow, monkeypatch):
    store.save("mine", meadow)

    def disk_full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", disk_full)
    with pytest.raises(StoreError, match="No space left"):
        store.save("mine", meadow.revised(name="Changed"))
    monkeypatch.undo()
    assert store.load("mine").name == meadow.name
    assert [path.name for path in (store.workspace / "scenarios").iterdir()] == ["mine.json"]


def test_a_damaged_file_is_listed_with_its_problem_and_does_not_hide_the_others(store, meadow):
    store.save("good", meadow)
    (store.workspace / "scenarios" / "bad.json").write_text("{")
    problems = {entry.id: entry.problem for entry in store.scenarios() if not entry.shipped}
    assert problems["good"] is None and "bad.json" in problems["bad"]
    with pytest.raises(ScenarioError):
        store.load("bad")


def test_a_run_is_kept_with_its_scenario_and_every_tick(store, meadow):
    frames = [tuple(float(i + j) for j in range(len(FRAME_COLUMNS))) for i in range(5)]
    run_id = store.add_run("mine", meadow, SUMMARY, frames, datetime(2026, 1, 2, tzinfo=UTC))
    again = Store(store.workspace)
    assert again.runs()[0]["id"] == run_id
    assert again.run(run_id) == {
        "id": run_id,
        "started_at": "2026-01-02T00:00:00+00:00",
        "scenario_id": "mine",
        **SUMMARY,
    }
    assert [tuple(row.values()) for row in again.frames(run_id)] == frames
    assert again.run_scenario(run_id).to_json() == meadow.to_json()


def test_runs_of_a_workspace_that_is_older_than_the_exposure_columns_can_be_read(tmp_path, meadow):
    store = Store(tmp_path / "now")
    frames = [tuple(float(i + j) for j in range(len(FRAME_COLUMNS))) for i in range(5)]
    store.add_run("mine", meadow, SUMMARY, frames, datetime(2026, 1, 2, tzinfo=UTC))
    old = [frame[: len(FIRST_COLUMNS)] for frame in frames]
    with closing(sqlite3.connect(store.workspace / "runs.sqlite")) as database, database:
        database.execute("ALTER TABLE runs DROP COLUMN columns")
        database.execute("UPDATE runs SET frames = ?", (zlib.compress(np.array(old).tobytes()),))
    again = Store(store.workspace)
    assert [tuple(row.values()) for row in again.frames(1)] == old
    new = again.add_run("mine", meadow, SUMMARY, frames, datetime(2026, 1, 3, tzinfo=UTC))
    assert [tuple(row.values()) for row in again.frames(new)] == frames


@pytest.mark.parametrize("missing", [0, -1, 7, 2**63, 10**30])
def test_an_unknown_run_is_refused(store, missing):
    with pytest.raises(UnknownEntry):
        store.run(missing)


def test_a_workspace_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot be used"):
        Store(tmp_path / "file")
