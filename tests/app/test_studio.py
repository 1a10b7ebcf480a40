"""The owner of the live state: edits, undo, refusals, and following the mission."""

import asyncio
import math
import os
import signal
from pathlib import Path

import pytest

from app.changes import Change, Kind, Selection, StudioError
from app.store import Store
from app.studio import Studio
from planner.frames import Status
from scenes.scenario import CoverSpec, ObserverSpec, ObstacleSpec

PATIENCE_S = 60.0


class SilentWorker:
    """Stands where the mission process would and notes the orders."""

    def __init__(self) -> None:
        self.orders: list[tuple] = []

    def load(self, *arguments) -> int:
        self.orders.append(("load", *arguments))
        return len(self.orders)

    def __getattr__(self, name):
        return lambda *arguments, **keywords: self.orders.append((name, *arguments))


@pytest.fixture
def studio(tmp_path: Path, meadow) -> Studio:
    """A studio whose mission process is not started: for all that is not about driving."""
    studio = Studio(Store(tmp_path), meadow, "meadow-test")
    studio._drive.worker = SilentWorker()
    return studio


def test_setting_the_goal_edits_the_scenario_and_tells_the_mission(studio):
    told = []
    studio.subscribe(told.append)
    studio.set_goal(2.0, 1.0)
    assert (studio.scenario.goal.x, studio.scenario.goal.y) == (2.0, 1.0)
    assert studio._drive.worker.orders[-1][0] == "edit"
    assert Change.EDITED in told and studio.dirty


def test_a_new_thing_takes_a_free_number_even_where_the_highest_is_taken(studio, meadow):
    last = meadow.observers[0].model_copy(update={"id": 1_000_000})
    studio.scenario = meadow.revised(observers=(last,))
    assert studio.add_observer(ObserverSpec(x=1.0, y=6.0)).id == 1


@pytest.mark.parametrize(
    ("edit", "reason"),
    [
        (lambda s: s.set_goal(50.0, 0.0), "goal is off the map"),
        (lambda s: s.set_goal(math.nan, 0.0), "finite"),
        (lambda s: s.set_goal(0.0, 5.1), "inside a tree"),
        (lambda s: s.add_cover(CoverSpec(kind="house", x=3.0, y=0.0)), "goal is inside a house"),
        (lambda s: s.add_observer(ObserverSpec(x=99.0, y=0.0)), "off the map"),
        (lambda s: s.update_observer(1, {"fov_horizontal": 400.0}), "fov_horizontal"),
        (lambda s: s.update_observer(1, {"height": 1.0}), "height"),
        (lambda s: s.update_observer(1, {"id": 2}), "id"),
        (lambda s: s.update_observer(7, {"x": 0.0}), "no observer 7"),
        (lambda s: s.delete_cover(9), "no cover object 9"),
        (lambda s: s.remove(Selection(Kind.GOAL)), "cannot be deleted"),
        (lambda s: s.set_speed(9.0), "speed"),
        (lambda s: s.set_speed(math.nan), "speed"),
        (lambda s: s.set_method("teleport"), "teleport"),
        (lambda s: s.set_perception("magic"), "magic"),
        (lambda s: s.set_seed(-1), "seed"),
        (lambda s: s.set_pose(0.0, 5.0, 0.0), "inside a tree"),
        (lambda s: s.undo(), "nothing to undo"),
        (lambda s: s.redo(), "nothing to redo"),
    ],
)
def test_what_cannot_be_done_is_refused_in_words_and_changes_nothing(studio, edit, reason):
    before = studio.scenario
    with pytest.raises(StudioError, match=reason):
        edit(studio)
    assert studio.scenario is before and not studio.can_undo


def test_every_edit_can_be_undone_and_redone(studio):
    original = studio.scenario
    edits = [
        lambda: studio.set_goal(2.0, 1.0),
        lambda: studio.set_start(-4.0, 0.0, 90.0),
        lambda: studio.add_observer(ObserverSpec(x=1.0, y=6.0)),
        lambda: studio.update_observer(1, {"range": 12.0}),
        lambda: studio.delete_observer(2),
        lambda: studio.add_cover(CoverSpec(kind="rock", x=-6.0, y=-6.0)),
        lambda: studio.update_cover(2, {"yaw": 30.0}),
        lambda: studio.delete_cover(1),
        lambda: studio.add_obstacle(ObstacleSpec(kind="person", x=5.0, y=-5.0)),
        lambda: studio.update_obstacle(1, {"x": 6.0}),
        lambda: studio.delete_obstacle(1),
    ]
    documents = [studio.scenario]
    for edit in edits:
        edit()
        documents.append(studio.scenario)
    for document in reversed(documents[:-1]):
        studio.undo()
        assert studio.scenario == document
    assert studio.scenario is original and not studio.dirty
    for document in documents[1:]:
        studio.redo()
        assert studio.scenario == document


def test_a_drag_is_one_undo_entry(studio):
    original = studio.scenario
    for step in range(10):
        studio.update_observer(1, {"x": 0.1 * step}, drag="gizmo-7")
    studio.update_observer(1, {"x": 3.0}, drag="gizmo-8")
    studio.undo()
    assert studio.scenario.observers[0].x == pytest.approx(0.9)
    studio.undo()
    assert studio.scenario is original


def test_a_new_edit_ends_what_could_be_redone(studio):
    studio.set_goal(2.0, 1.0)
    studio.undo()
    studio.set_goal(2.0, -1.0)
    assert not studio.can_redo


def test_ids_are_not_used_again_while_a_later_one_lives(studio):
    assert studio.add_observer(ObserverSpec(x=1.0, y=6.0)).id == 2
    studio.delete_observer(1)
    assert studio.add_observer(ObserverSpec(x=1.0, y=7.0)).id == 3


def test_deleting_what_is_selected_ends_the_selection(studio):
    studio.select(Selection(Kind.OBSERVER, 1))
    studio.delete_observer(1)
    assert studio.selection is None


def test_saving_keeps_a_document_and_ends_dirty(studio):
    studio.set_goal(2.0, 1.0)
    studio.save()
    assert not studio.dirty
    assert studio.store.load("meadow-test").goal == studio.scenario.goal


def test_what_was_not_saved_is_kept_when_another_scenario_opens(studio):
    studio.set_goal(2.0, 1.0)
    edited = studio.scenario
    shipped = next(entry.id for entry in studio.library() if entry.shipped)
    asyncio.run(studio.open(shipped))
    kept = studio.store.load("unsaved-changes")
    assert kept.goal == edited.goal and kept.name == f"{edited.name} (unsaved changes)"
    asyncio.run(studio.open("unsaved-changes"))
    assert studio.dirty and studio.scenario.goal == edited.goal and studio.scenario.name == edited.name
    saved = studio.save()
    assert saved != "unsaved-changes" and not studio.dirty
    assert studio.store.load(saved).goal == edited.goal


def test_what_is_saved_is_never_where_unsaved_changes_are_kept(studio):
    assert studio.save_as("Unsaved changes") != "unsaved-changes"
    with pytest.raises(StudioError, match="holds unsaved changes"):
        asyncio.run(studio.replace("unsaved-changes", studio.scenario))


def test_a_scenario_without_changes_leaves_nothing_behind(studio):
    asyncio.run(studio.open(next(entry.id for entry in studio.library() if entry.shipped)))
    assert not studio.store.holds("unsaved-changes")


def test_saving_a_shipped_scenario_makes_a_copy(studio):
    shipped = next(entry.id for entry in studio.library() if entry.shipped)
    studio.scenario_id = shipped
    saved = studio.save()
    assert saved != shipped and not studio.store.is_shipped(saved)


def test_a_failing_listener_does_not_stop_the_others(studio):
    told = []
    studio.subscribe(lambda change: 1 / 0)
    studio.subscribe(told.append)
    studio.set_goal(2.0, 1.0)
    assert told


def live(tmp_path, meadow, story) -> None:
    """Run a story with a studio whose mission process is real."""

    async def play() -> None:
        studio = Studio(Store(tmp_path), meadow, "meadow-test")
        await studio.start()
        try:
            await asyncio.wait_for(story(studio), 3 * PATIENCE_S)
        finally:
            await studio.close()

    asyncio.run(play())


async def until(condition) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.01)


def test_a_drive_reaches_the_goal_is_stored_and_goes_on_to_the_next(tmp_path, meadow):
    async def story(studio: Studio) -> None:
        studio.set_speed(8.0)
        studio.set_perception("oracle")
        await until(lambda: studio.frame is not None or studio.status is Status.IDLE)
        studio.play()
        await until(lambda: studio.status is Status.REACHED)
        await until(studio.store.runs)
        assert studio.store.runs()[0]["success"]
        studio.set_goal(-3.0, -2.0)
        await until(lambda: studio.status is Status.RUNNING)
        await until(lambda: studio.status is Status.REACHED)
        assert math.dist((studio.frame.pose.x, studio.frame.pose.y), (-3.0, -2.0)) < 0.35

    live(tmp_path, meadow, story)


def test_an_edit_in_mid_drive_takes_effect_without_a_restart(tmp_path, meadow):
    async def story(studio: Studio) -> None:
        studio.set_perception("oracle")
        studio.play()
        await until(lambda: studio.frame is not None and studio.frame.time_s > 1.0)
        studio.add_observer(ObserverSpec(x=-6.0, y=6.0))
        await until(lambda: len(studio.frame.observers) == 2)
        assert studio.frame.time_s > 1.0 and studio.status is Status.RUNNING

    live(tmp_path, meadow, story)


def test_a_dead_mission_process_is_said_and_the_mission_goes_on(tmp_path, meadow):
    async def story(studio: Studio) -> None:
        studio.set_perception("oracle")
        studio.play()
        await until(lambda: studio.frame is not None and studio.frame.time_s > 1.0)
        os.kill(studio._drive.worker.pid, signal.SIGKILL)
        await until(lambda: studio.error is not None)
        assert "SIGKILL" in studio.message
        studio.play()
        await until(lambda: studio.error is None and studio.status is Status.REACHED)

    live(tmp_path, meadow, story)


def test_nothing_is_put_or_brought_back_where_the_robot_stands(tmp_path, meadow):
    async def story(studio: Studio) -> None:
        studio.set_perception("oracle")
        rock = studio.add_cover(CoverSpec(kind="rock", x=-3.0, y=-3.0))
        studio.delete_cover(rock.id)
        studio.step()
        await until(lambda: studio.frame is not None and studio.frame.tick == 1)
        studio.set_pose(-3.0, -3.0, 0.0)
        await until(lambda: studio.frame.pose.y < -2.5)
        for put in (
            studio.undo,
            lambda: studio.add_cover(CoverSpec(kind="rock", x=-3.2, y=-3.0)),
            lambda: studio.add_obstacle(ObstacleSpec(kind="vehicle", x=-1.0, y=-3.0)),
        ):
            with pytest.raises(StudioError, match="the robot stands there"):
                put()
        assert studio.can_undo and not studio.can_redo

    live(tmp_path, meadow, story)


def test_commands_posted_from_other_threads_keep_their_order_and_report_refusals(tmp_path, meadow):
    async def story(studio: Studio) -> None:
        refused = []

        def elsewhere() -> None:
            for step in range(50):
                studio.post(studio.set_goal, 0.05 * step, -1.0)
            studio.post(studio.set_goal, 99.0, 0.0, on_error=refused.append)
            studio.post(studio.open, "no-such-scenario", on_error=refused.append)

        await asyncio.to_thread(elsewhere)
        await until(lambda: len(refused) == 2)
        assert studio.scenario.goal.x == pytest.approx(0.05 * 49)
        assert "off the map" in refused[0] and "no-such-scenario" in refused[1]

    live(tmp_path, meadow, story)
