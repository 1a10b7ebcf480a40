"""Running: finished missions are not driven twice, killed workers do not end it, and it stops when told."""

import threading
from functools import partial

import pytest
from crashing import attempt
from drives import mission
from joblib.externals.loky.process_executor import BrokenProcessPool

from planner import evaluation
from planner.evaluation import specs
from planner.evaluation_journal import Journal
from planner.evaluation_run import ATTEMPTS, Local, Plan, Worker, evaluate
from planner.frames import Perception
from planner.suites import Suite
from scenes.scenario import Family


def wanted(count=4, suite=Suite.RANDOM):
    return specs(["dwa"], [Family.NORMAL], count, 0, Perception.LIDAR, 12.0, suite)


@pytest.fixture
def driven(monkeypatch):
    """The specs that were driven, in order; nobody really drives."""
    found = []

    def drive(spec):
        found.append(spec)
        return mission(spec.seed, "stuck", suite=str(spec.suite))

    monkeypatch.setattr(evaluation, "drive", drive)
    return found


def test_finished_missions_are_taken_from_the_journal(tmp_path, driven):
    with Journal(tmp_path) as journal:
        for seed in range(3):
            journal.add(mission(seed))
        results = list(evaluate(wanted(), Local(1), journal))
    assert [m["status"] for m in results] == ["reached"] * 3 + ["stuck"]
    assert [spec.seed for spec in driven] == [3]
    with Journal(tmp_path) as journal:
        assert list(evaluate(wanted(), Local(1), journal)) == results
    assert len(driven) == 1


def test_a_journal_keeps_suites_apart(tmp_path, driven):
    with Journal(tmp_path) as journal:
        journal.add(mission(0, suite="covert", observers="known"))
        for suite in (Suite.COVERT, Suite.RANDOM):
            list(evaluate(wanted(1, suite), Local(1), journal))
    assert [spec.suite for spec in driven] == [Suite.RANDOM]


def test_what_goes_wrong_in_a_mission_is_its_result(monkeypatch):
    def drive(spec):
        if spec.seed == 1:
            raise RuntimeError("the wheels\ncame off")
        return mission(spec.seed)

    monkeypatch.setattr(evaluation, "drive", drive)
    statuses = {m["seed"]: m for m in evaluate(wanted(3), Local(1))}
    assert [statuses[seed]["status"] for seed in range(3)] == ["reached", "error", "reached"]
    assert statuses[1]["reason"] == "RuntimeError: the wheels came off"


def test_when_told_to_stop_it_begins_no_more_and_keeps_what_is_finished(tmp_path, driven):
    stop = threading.Event()
    with Journal(tmp_path) as journal:
        for _ in evaluate(wanted(), Local(1), journal, stop):
            stop.set()
        assert len(journal.results) == len(driven) < 4


def test_a_full_disk_stops_it_too(tmp_path, driven):
    with Journal(tmp_path) as journal:
        for _ in evaluate(wanted(), Local(1), journal):
            journal.full = True
        assert len(driven) < 4 and len(journal.results) == len(driven)


def test_who_has_driven_a_mission_gets_its_other_methods_and_the_last_are_shared():
    plan = Plan(specs(["dwa", "terp", "route"], [Family.NORMAL], 3, 0, Perception.LIDAR, 12.0))

    def taken(who, count):
        return [(spec.seed, spec.method) for spec in (plan.next_for(who) for _ in range(count)) if spec]

    assert taken("one", 2) == [(0, "dwa"), (0, "terp")]
    assert taken("other", 1) == [(1, "dwa")]
    assert taken("one", 4) == [(0, "route"), (2, "dwa"), (2, "terp"), (2, "route")]
    assert taken("one", 1) == [(1, "route")], "the other goes on with what is next"
    assert taken("other", 2) == [(1, "terp")] and taken("one", 1) == []


def test_what_is_put_back_is_next():
    plan = Plan(specs(["dwa", "terp"], [Family.NORMAL], 1, 0, Perception.LIDAR, 12.0))
    plan.next_for("one")
    shared = plan.next_for("other")
    plan.put_back("other", shared)
    assert plan.next_for("other") is shared and plan.next_for("one") is None


class Dead:
    """An executor whose process is gone."""

    def submit(self, *_):
        raise BrokenProcessPool("gone")

    def shutdown(self, **_):
        pass


def test_a_process_that_died_while_it_had_nothing_to_do_is_renewed():
    worker = Worker(1, ())
    worker.end(at_once=True)
    worker._executor = Dead()
    assert worker.begin(str, "seven").result() == "seven"
    worker.end(at_once=False)


def test_what_a_killed_worker_was_driving_is_driven_again_and_at_last_counted_as_an_error(tmp_path):
    marks = tmp_path / "marks"
    marks.mkdir()
    with Journal(tmp_path / "out") as journal:
        results = {m["seed"]: m for m in evaluate(wanted(3), Local(2, partial(attempt, marks)), journal)}
        assert len(journal.results) == 3
    assert results[1]["status"] == "error" and "its process was killed 2 times" in results[1]["reason"]
    assert [results[seed]["status"] for seed in (0, 2)] == ["reached"] * 2
    assert len(list(marks.glob("1-*"))) >= ATTEMPTS and len(list(marks.glob("2-*"))) >= 2
