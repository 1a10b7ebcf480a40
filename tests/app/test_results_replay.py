"""Replays: the scene opens, the ghosts go as they went, and they leave with the scene."""

import asyncio

import numpy as np
import pytest
from evaluations import drive, drives, results_file, scene

from app.changes import StudioError
from app.results import Evaluation
from app.view.panel_replay import words


@pytest.fixture
def evaluation(tmp_path):
    other = {"scene": drive(9, "dwa")["scene"] | {"name": "another"}}
    return Evaluation(results_file(tmp_path / "r.sqlite", [*drives(1), drive(9, "dwa", **other)]))


def played(view, go):
    """Run a coroutine with the view's replay service on a loop of its own."""

    async def main():
        view.studio._loop = asyncio.get_running_loop()
        try:
            await go(view.replay.service)
        finally:
            view.replay.service.close()
            await asyncio.gather(*view._tasks, return_exceptions=True)

    asyncio.run(main())


def test_two_methods_stand_side_by_side_where_they_were(view, evaluation):
    async def go(service):
        await service.open(evaluation, (1, 2))
        assert view.studio.scenario.to_json() == scene().to_json()
        assert service.playing and service.replay.duration_s == 10.0
        service.pause()
        service.seek(5.0)
        ours, theirs = service.poses()
        middle = (scene().start.x + scene().goal.x) / 2
        assert ours.x == pytest.approx(middle, abs=0.02) and theirs.y - ours.y == pytest.approx(0.4, abs=0.02)
        show = view.replay
        assert len(show._ghosts) == 2 and show._ghosts[1]._label.text == "covernav: hidden"
        assert np.allclose(show._ghosts[0]._frame.position, ours.position)
        service.seek(99.0)
        assert service.time_s == 10.0 and show._ghosts[0]._label.text == "dwa: reached"

    played(view, go)


def test_it_plays_to_the_end_and_begins_again(view, evaluation):
    async def go(service):
        await service.open(evaluation, (1,))
        service.set_speed(16.0)
        service.seek(9.5)
        for _ in range(100):
            await asyncio.sleep(0.02)
            if not service.playing:
                break
        assert service.time_s == 10.0 and not service.playing
        service.play()
        assert service.time_s == 0.0 and service.playing

    played(view, go)


def test_the_way_driven_is_brighter_than_the_way_to_come(view, evaluation):
    async def go(service):
        await service.open(evaluation, (1,))
        service.pause()
        service.seek(5.0)
        light = np.asarray(view.replay._lines[0]._handle.colors, int).sum(axis=(1, 2))
        assert len(light) == 20 and light[:10].min() > light[10:].max()

    played(view, go)


def test_another_scene_ends_the_replay(view, evaluation):
    async def go(service):
        await service.open(evaluation, (1, 2))
        await view.studio.open_document(scene())
        assert service.replay is None and not service.playing and view.replay._ghosts == []
        with pytest.raises(StudioError, match="results page"):
            service.play()

    played(view, go)


def test_missions_of_two_scenes_and_times_that_are_none_are_refused(view, evaluation):
    async def go(service):
        with pytest.raises(StudioError, match="different scenes"):
            await service.open(evaluation, (1, 3))
        with pytest.raises(LookupError):
            await service.open(evaluation, (77,))
        await service.open(evaluation, (1,))
        for command, value in ((service.seek, float("nan")), (service.seek, -1.0), (service.set_speed, 99.0)):
            with pytest.raises(StudioError):
                command(value)

    played(view, go)


def test_the_panel_names_the_drives(view, evaluation):
    async def go(service):
        await service.open(evaluation, (1, 2))
        text = words(service.replay)
        assert "covernav: reached after 10.0 s" in text and "two methods" in text

    played(view, go)
