"""The journal: whole lines, one writer, and nothing finished is lost, not even on a full disk."""

import errno
import json
import os

import pytest
from drives import mission

from planner.evaluation import MissionSpec, failed
from planner.evaluation_journal import RESERVE, Journal, JournalError


def lines(folder):
    return (folder / "missions.jsonl").read_text().splitlines()


def test_what_was_added_is_there_the_next_time(tmp_path):
    with Journal(tmp_path) as journal:
        journal.add(mission(1))
        journal.add(mission(2, suite="covert"))
    with Journal(tmp_path) as journal:
        assert [spec.seed for spec in journal.results] == [1, 2]
        assert [spec.suite for spec in journal.results] == ["random", "covert"]


def test_a_line_that_was_cut_off_goes_and_the_next_stands_whole(tmp_path):
    with Journal(tmp_path) as journal:
        journal.add(mission(1))
    with (tmp_path / "missions.jsonl").open("a") as stream:
        stream.write('{"terrain": "nor')
    with Journal(tmp_path) as journal:
        journal.add(mission(2))
    assert [json.loads(line)["seed"] for line in lines(tmp_path)] == [1, 2]


def test_errors_are_kept_but_driven_again(tmp_path):
    spec = MissionSpec.of(mission(3))
    with Journal(tmp_path) as journal:
        journal.add(failed(spec, "its worker process was killed"))
        assert spec in journal.results
    with Journal(tmp_path) as journal:
        assert spec not in journal.results
        journal.add(mission(3))
    with Journal(tmp_path) as journal:
        assert journal.results[spec]["status"] == "reached"


def test_a_folder_of_something_else_is_refused_and_left_alone(tmp_path):
    (tmp_path / "holiday.jpg").write_bytes(b"sea")
    with pytest.raises(JournalError, match="not empty and holds no evaluation"):
        Journal(tmp_path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["holiday.jpg"]


@pytest.mark.parametrize("text", ["hello\n", '{"terrain": "moon"}\n', "[]\n", '{"seed": {}}\n'])
def test_a_journal_of_something_else_is_refused_and_left_alone(tmp_path, text):
    (tmp_path / "missions.jsonl").write_text(text)
    with pytest.raises(JournalError, match="line 1"):
        Journal(tmp_path)
    assert (tmp_path / "missions.jsonl").read_text() == text


def test_damaged_lines_among_good_ones_cost_their_own_missions_alone(tmp_path):
    with Journal(tmp_path) as journal:
        journal.add(mission(1))
    path = tmp_path / "missions.jsonl"
    path.write_bytes(path.read_bytes() + b"garbage\n")
    with Journal(tmp_path) as journal:
        assert journal.damaged == 1
        journal.add(mission(2))
    with Journal(tmp_path) as journal:
        assert [spec.seed for spec in journal.results] == [1, 2] and journal.damaged == 1


def test_zeros_that_a_power_failure_left_at_the_end_are_cut_off(tmp_path):
    with Journal(tmp_path) as journal:
        journal.add(mission(1))
    path = tmp_path / "missions.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole + bytes(100))
    with Journal(tmp_path) as journal:
        assert [spec.seed for spec in journal.results] == [1] and journal.damaged == 0
    assert path.read_bytes() == whole


def test_two_evaluations_do_not_write_into_one_folder(tmp_path):
    with Journal(tmp_path), pytest.raises(JournalError, match="another evaluation"):
        Journal(tmp_path)


@pytest.fixture
def full_disk(monkeypatch, tmp_path):
    """Writes fail after half a line until something is deleted."""
    whole, gone = os.write, os.unlink
    state = {"full": False}

    def write(handle, data):
        if not state["full"]:
            return whole(handle, data)
        whole(handle, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    def unlink(path, **named):
        state["full"] = False
        gone(path, **named)

    monkeypatch.setattr(os, "write", write)
    monkeypatch.setattr(os, "unlink", unlink)
    return state


def test_a_full_disk_takes_what_is_finished_out_of_the_reserve(tmp_path, full_disk):
    with Journal(tmp_path) as journal:
        journal.add(mission(1))
        assert (tmp_path / RESERVE).stat().st_size == 2**20
        full_disk["full"] = True
        journal.add(mission(2))
        assert journal.full and not (tmp_path / RESERVE).exists()
        full_disk["full"] = True
        with pytest.raises(OSError, match="No space left"):
            journal.add(mission(3))
        full_disk["full"] = False
    assert [json.loads(line)["seed"] for line in lines(tmp_path)] == [1, 2]


def test_nothing_but_the_journal_stays_behind(tmp_path):
    with Journal(tmp_path) as journal:
        journal.add(mission(1))
    assert [entry.name for entry in tmp_path.iterdir()] == ["missions.jsonl"]


def test_a_last_line_that_lacks_but_its_end_is_kept(tmp_path):
    with Journal(tmp_path) as journal:
        journal.add(mission(1))
        journal.add(mission(2))
    path = tmp_path / "missions.jsonl"
    path.write_bytes(path.read_bytes().rstrip(b"\n"))
    with Journal(tmp_path) as journal:
        journal.add(mission(3))
    assert [json.loads(line)["seed"] for line in lines(tmp_path)] == [1, 2, 3]


@pytest.mark.parametrize("content", [b"my own notes", b'{"mine": 1', b"\xff\xfe\n", b'{"mine": 1}', b"\x00"])
def test_a_foreign_file_without_an_end_of_line_is_left_alone(tmp_path, content):
    (tmp_path / "missions.jsonl").write_bytes(content)
    with pytest.raises(JournalError, match="line 1"):
        Journal(tmp_path)
    assert (tmp_path / "missions.jsonl").read_bytes() == content
