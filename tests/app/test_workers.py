"""The mission process: obeys, reports, and is replaced when it dies."""

import os
import queue
import signal
import threading
import time

import numpy as np
import pytest

from app.mission_process import Progress
from app.workers import RESTARTS_BEFORE_GIVING_UP, MissionWorker
from planner.frames import Perception, Status
from scenes.scenario import Point

PATIENCE_S = 60.0


class Reports:
    """Collects what a worker says and waits for a report that fulfils a condition."""

    def __init__(self) -> None:
        self.queue: queue.Queue = queue.Queue()
        self.refusals: queue.Queue = queue.Queue()
        self.deaths: queue.Queue = queue.Queue()

    def until(self, condition) -> Progress:
        while True:
            report, current = self.queue.get(timeout=PATIENCE_S)
            if current and condition(report):
                return report


@pytest.fixture
def reports():
    return Reports()


@pytest.fixture
def worker(reports):
    worker = MissionWorker(
        lambda report, current: reports.queue.put((report, current)),
        reports.refusals.put,
        lambda reason, restoring: reports.deaths.put((reason, restoring)),
    )
    worker.start()
    yield worker
    worker.close()


def test_a_mission_is_driven_to_its_end_and_every_tick_is_reported(worker, reports, meadow):
    worker.set_speed(8.0)
    worker.load(meadow, "least_cost", 0, Perception.ORACLE)
    idle = reports.until(lambda report: True)
    assert idle.status is Status.IDLE
    worker.play(True)
    rows = []

    def over(report):
        rows.extend(report.rows)
        return report.status.final

    last = reports.until(over)
    assert last.status is Status.REACHED and last.summary["success"]
    assert [round(row[0], 6) for row in rows] == [round(0.1 * (i + 1), 6) for i in range(len(rows))]
    assert rows[-1][0] == pytest.approx(last.frame.time_s)


def test_a_step_is_one_tick_and_then_a_pause(worker, reports, meadow):
    worker.load(meadow, "least_cost", 0, Perception.ORACLE)
    reports.until(lambda report: report.status is Status.IDLE)
    worker.step()
    first = reports.until(lambda report: report.status is Status.PAUSED)
    assert first.frame.tick == 1
    worker.step()
    assert reports.until(lambda report: report.frame.tick != 1).frame.tick == 2


def test_a_killed_process_is_replaced_and_goes_on_from_its_last_state(worker, reports, meadow):
    worker.load(meadow, "least_cost", 0, Perception.ORACLE)
    worker.play(True)
    before = reports.until(lambda report: report.frame is not None and report.frame.time_s > 1.0)
    os.kill(worker.pid, signal.SIGKILL)
    assert reports.deaths.get(timeout=PATIENCE_S) == ("was ended by SIGKILL", True)
    restored = reports.until(lambda report: report.status is Status.PAUSED)
    assert restored.frame.pose.x > meadow.start.x + 0.05
    worker.play(True)
    after = reports.until(lambda report: report.frame.time_s > before.frame.time_s + 0.5)
    assert after.frame.pose.x > restored.frame.pose.x


def test_where_it_was_put_is_kept_over_a_death(worker, reports, meadow):
    worker.load(meadow, "least_cost", 0, Perception.ORACLE)
    worker.step()
    reports.until(lambda report: report.status is Status.PAUSED)
    worker.set_pose(-3.0, -3.0, 0.0)
    reports.until(lambda report: report.frame.pose.y < -2.5)
    os.kill(worker.pid, signal.SIGKILL)
    reports.deaths.get(timeout=PATIENCE_S)
    restored = reports.until(lambda report: report.status is Status.PAUSED)
    assert (restored.frame.pose.x, restored.frame.pose.y) == pytest.approx((-3.0, -3.0), abs=0.1)


def test_stopped_it_stays_whatever_the_goal_until_it_is_told_to_play(worker, reports, meadow):
    worker.load(meadow, "least_cost", 0, Perception.ORACLE, playing=True)
    reports.until(lambda report: report.frame is not None and report.frame.tick >= 3)
    worker.stop()
    stopped = reports.until(lambda report: report.status is Status.STOPPED)
    worker.edit(meadow.revised(goal=Point(x=2.0, y=-2.0)), ("goal",), goal_set=True)
    waiting = reports.until(lambda report: report.status is not Status.STOPPED)
    assert waiting.status is Status.PAUSED and waiting.frame.tick == stopped.frame.tick
    worker.play(True)
    reports.until(lambda report: report.frame.tick > stopped.frame.tick)


def test_an_order_is_taken_at_once_while_a_process_is_starting(worker, meadow):
    ground = meadow.terrain.model_copy(
        update={"heights": np.zeros((900, 900)), "surface": ("g" * 900,) * 900, "quality": None}
    )
    worker.load(meadow.model_copy(update={"terrain": ground}), "least_cost", 0, Perception.ORACLE)
    giving = threading.Thread(target=worker.step, daemon=True)
    giving.start()
    giving.join(1.0)
    assert not giving.is_alive() and worker.pid is not None


def test_a_process_that_dies_again_and_again_is_given_up_until_asked_for(worker, reports, meadow):
    worker.load(meadow, "least_cost", 0, Perception.ORACLE)
    died = []
    while not died or died[-1]:
        while worker.pid is None:  # the next one is being started
            time.sleep(0.01)
        os.kill(worker.pid, signal.SIGKILL)
        died.append(reports.deaths.get(timeout=PATIENCE_S)[1])
    assert died == [True] * (RESTARTS_BEFORE_GIVING_UP - 1) + [False]
    worker.load(meadow, "least_cost", 0, Perception.ORACLE)
    assert reports.until(lambda report: report.status is Status.IDLE)


def test_an_order_that_cannot_be_carried_out_is_refused_in_words(worker, reports, meadow):
    worker.load(meadow, "least_cost", 0, Perception.ORACLE)
    worker.set_method("teleport")
    assert "teleport" in reports.refusals.get(timeout=PATIENCE_S)


def test_closing_ends_the_process(reports, meadow):
    worker = MissionWorker(lambda *_: None, lambda *_: None, lambda *_: None)
    worker.start()
    worker.load(meadow, "least_cost", 0, Perception.ORACLE)
    pid = worker.pid
    worker.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
