"""Trainings: one at a time in a process of its own, stopped and gone on with; nothing finished is lost."""

import asyncio
import os
import signal
from contextlib import closing

import numpy as np
import pytest
from meadows import meadow_scene
from trainings import LONG, SHORT, opened, over, until

from app.changes import Change, StudioError
from app.store import StoreError, UnknownEntry, connected
from app.training_plan import Task, TrainingPlan, TrainingStatus
from app.training_process import Drawn, Moved, training_settings
from app.training_records import TrainingRecords
from app.training_service import TrainingService
from app.training_sight import Seen, Sight
from app.training_trial import Driver
from scenes.scenario import CoverObject, ScenarioError, Start


def test_a_training_runs_to_its_end_and_is_told_recorded_and_shown(tmp_path):
    async def go():
        studio, service = opened(tmp_path, meadow_scene())
        told, views = [], []
        studio.subscribe(told.append)
        service.watch(views.append)
        training = await service.start(SHORT.model_copy(update={"demonstrations": 34}))
        assert service.live is training and training.status is TrainingStatus.STARTING
        with pytest.raises(StudioError, match="training 1 is starting: stop it first") as refused:
            await service.start(SHORT)
        assert refused.value.status == 409
        assert await over(training) is TrainingStatus.DONE, training.message
        assert service.live is None and told.count(Change.TRAINING) >= 5
        assert [row["number"] for row in training.episodes] == [0, 1, 2]
        assert all(row["steps"] == 4 and "goal" in row["terms"] for row in training.episodes)
        assert [row["number"] for row in training.driven] == [0, 1], "the last of three is a demonstration"
        assert list(training.checkpoints()) == ["episode_000000", "policy"]
        with pytest.raises(StudioError, match="complete"):
            service.resume(training.id)
        check_views(views)
        await service.use(training.id, "policy")
        kept = tmp_path / "policies" / "training-1-episode-3.safetensors"
        assert (studio.method, studio.weights) == ("covernav_paper", kept) and kept.is_file()
        await check_comparison(service)
        await check_spoilt_checkpoint(studio, service, training)
        await service.close()
        found = TrainingRecords(tmp_path).load()
        assert found == [training], "all of it is on record"

    asyncio.run(go())


def check_views(views):
    drawn = [view for view in views if isinstance(view, Drawn)]
    assert [view.episode for view in drawn] == [0, 1, 2] and drawn[0].scenario.name == "Test meadow"
    assert sum(len(view.poses) for view in views if isinstance(view, Moved)) == 12
    sight = next(view for view in views if isinstance(view, Sight))
    assert {Seen.ELEVATION, Seen.ATTENTION, Seen.COST} <= set(sight.seen)
    assert set(sight.truth) == {Seen.ELEVATION, Seen.EXPOSURE, Seen.COVER, Seen.COST}
    assert {patch.shape for patch in (*sight.seen.values(), *sight.truth.values())} == {(40, 40)}


async def check_comparison(service):
    compared = await service.compare(1, "episode_000000", "policy", Driver.NETWORK)
    before, after = compared.trials
    assert np.array_equal(before.points[0], after.points[0]) and len(before.points) > 1
    again = await service.compare(1, "episode_000000", "policy", Driver.NETWORK)
    assert np.array_equal(before.points, again.trials[0].points), "the same seed, the same drive"
    service.forget_comparison()
    assert service.compared is None


async def check_spoilt_checkpoint(studio, service, training):
    used = studio.weights
    whole = training.checkpoint("policy").read_bytes()
    for content, words in (
        (whole[: len(whole) // 2], "truncated, or not a safetensors file"),
        (b"\x80\x04K\x01.", "not a safetensors file"),
        (b"\x02" + bytes(7) + b"{}", "does not say which architecture"),
    ):
        (training.folder / "policy.safetensors").write_bytes(content)
        with pytest.raises(StudioError, match=words) as refused:
            await service.use(training.id, "policy")
        assert str(refused.value).startswith("trainings/0001/policy.safetensors")
    assert studio.weights == used, "what drives goes on driving"
    with pytest.raises(UnknownEntry, match="no checkpoint 'episode_000010'; it has episode_000000, policy"):
        await service.use(training.id, "episode_000010")


def test_pause_resume_stop_and_what_death_leaves(tmp_path):
    async def go():
        _, service = opened(tmp_path, meadow_scene())
        training = await service.start(LONG)
        with pytest.raises(StudioError, match="starting, not running"):
            service.pause(training.id)
        await until(lambda: len(training.episodes) >= 2)
        service.pause(training.id)
        await asyncio.sleep(1.0)
        held = len(training.episodes)
        await asyncio.sleep(1.0)
        assert training.status is TrainingStatus.PAUSED and len(training.episodes) == held
        service.resume(training.id)
        await until(lambda: len(training.episodes) > held)
        os.kill(service._running.process.pid, signal.SIGKILL)
        assert await over(training) is TrainingStatus.INTERRUPTED
        done = len(training.episodes)
        assert training.message == f"the training was ended by SIGKILL; resume goes on after episode {done}"
        service.resume(training.id)
        await until(lambda: len(training.episodes) > done)
        await service.close()
        assert training.status is TrainingStatus.RUNNING, "as the record has it when the studio goes"
        await check_found_again(tmp_path, len(training.episodes))

    asyncio.run(go())


async def check_found_again(workspace, done):
    _, service = opened(workspace, meadow_scene())
    training = service.training(1)
    assert training.status is TrainingStatus.INTERRUPTED and "the studio was closed" in training.message
    assert len(training.episodes) >= done
    assert [row["number"] for row in training.episodes] == list(range(len(training.episodes)))
    service.resume(1)
    service.stop(1)
    assert await over(training) is TrainingStatus.STOPPED, "also before it has begun"
    await service.delete(1)
    assert service.trainings == [] and not training.folder.exists()
    with pytest.raises(UnknownEntry, match="no training 1"):
        service.stop(1)
    await service.close()
    assert TrainingRecords(workspace).load() == []


def test_what_cannot_be_trained_is_refused_before_anything_starts(tmp_path):
    ring = tuple(
        CoverObject(id=number, kind="cottage", x=x, y=y, length=length, width=width)
        for number, (x, y, length, width) in enumerate(
            [(3.0, 2.5, 6.0, 1.0), (3.0, -2.5, 6.0, 1.0), (0.4, 0.0, 1.0, 6.0), (5.6, 0.0, 1.0, 6.0)], 1
        )
    )
    walled = meadow_scene().model_copy(update={"cover": ring})

    async def go():
        _, service = opened(tmp_path, walled)
        with pytest.raises(ScenarioError, match="no reachable goal"):
            await service.start(TrainingPlan(task=Task.MISSION))
        assert service.trainings == [] and service.live is None
        await service.close()

    asyncio.run(go())


def test_drives_that_the_ground_has_no_room_for_are_refused(tmp_path):
    async def go():
        far = meadow_scene()
        studio, service = opened(tmp_path, far)
        studio.scenario = far.model_copy(update={"start": Start(x=-150.0, y=0.0)})
        with pytest.raises(ScenarioError, match="move its goal nearer"):
            await service.start(TrainingPlan(task=Task.GROUND))
        assert service.trainings == [] and service.live is None
        await service.close()

    asyncio.run(go())


def test_two_that_begin_at_once_do_not_both_learn(tmp_path):
    async def go():
        _, service = opened(tmp_path, meadow_scene())
        old = await put_on_record(service)
        old.status = TrainingStatus.STOPPED
        old.folder.mkdir(parents=True)
        (old.folder / "settings.json").write_text("{}")
        beginning = asyncio.create_task(service.start(LONG))
        await asyncio.sleep(0)
        with pytest.raises(StudioError, match="one learns at a time") as refused:
            service.resume(old.id)
        assert refused.value.status == 409
        training = await beginning
        assert service.live is training
        await service.delete(training.id)
        await service.close()

    asyncio.run(go())


def test_a_comparison_of_a_scene_that_has_changed_is_not_shown(tmp_path, monkeypatch):
    async def go():
        studio, service = opened(tmp_path, meadow_scene())
        training = await put_on_record(service)
        monkeypatch.setattr(type(training), "checkpoint", lambda self, name: self.folder / name)

        async def asked(*_):
            studio.scenario = studio.scenario.model_copy(update={"name": "another"})

        monkeypatch.setattr(service, "_ask", asked)
        with pytest.raises(StudioError, match="changed meanwhile"):
            await service.compare(training.id, "before", "after", Driver.NETWORK)
        assert service.compared is None
        await service.close()

    asyncio.run(go())


@pytest.mark.parametrize("task", [Task.GROUND, Task.CURRICULUM])
def test_a_training_says_all_that_it_takes_to_go_on_elsewhere(task):
    plan = TrainingPlan(task=task, episodes=3, demonstrations=30)
    document = None if task is Task.CURRICULUM else meadow_scene().to_json()
    settings = training_settings(plan, document)
    assert settings.curriculum is (task is Task.CURRICULUM)
    if task is Task.GROUND:
        (drives,) = settings.resets
        assert drives["observers"] == len(meadow_scene().observers) and "terrain" not in drives
    assert (settings.episodes, settings.demonstrations) == (3, 30)


async def put_on_record(service: TrainingService):
    training = service._records.add(SHORT, "Test meadow")
    service._trainings[training.id] = training
    return training


def test_a_full_disk_is_said_and_the_training_can_be_resumed(tmp_path):
    async def go():
        _, service = opened(tmp_path, meadow_scene())
        training = await put_on_record(service)
        training.folder.parent.mkdir()
        training.folder.write_text("a file where the folder should be")
        service._begin(training, meadow_scene().to_json())
        assert await over(training) is TrainingStatus.FAILED
        assert "trainings/0001 cannot be written" in training.message
        await service.close()

    asyncio.run(go())


@pytest.mark.parametrize("damage", ["UPDATE trainings SET plan = '{'", "UPDATE trainings SET status = 'odd'"])
def test_a_training_whose_record_is_damaged_is_said(tmp_path, damage):
    TrainingRecords(tmp_path).add(SHORT, "Test meadow")
    with closing(connected(tmp_path)) as database, database:
        database.execute(damage)
    with pytest.raises(StoreError, match=r"the trainings in .* cannot be read"):
        TrainingRecords(tmp_path).load()
