"""The exposure in the background: after every change, the newest wins, nothing for nobody; and routes."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest
from meadows import meadow_scene
from served import silent_studio

from app.changes import Change, Overlay, StudioError
from app.drive import Drive
from app.exposure_fields import Over
from app.exposure_service import ExposureService
from app.route_process import CHOICES, Comparison, Situation, compare, hiding_place, watchers
from app.route_service import RouteService
from app.telemetry import Revisions, telemetry_document
from app.timeline import Timeline
from planner.exposure import SEEN
from planner.frames import Exposure, Frame, Metrics, Status, Watch
from planner.no_route import NoRoute
from scenes.pose import Pose, Twist
from scenes.scenario import CoverSpec, ObserverSpec, Patrol, Point


@pytest.fixture
def studio(tmp_path):
    return silent_studio(tmp_path, meadow_scene())


def frame(time_s: float = 0.0, tick: int = 1, exposure: Exposure | None = None) -> Frame:
    pose, still = Pose(0.1 * tick, 0.0, 0.0), Twist(0.0, 0.0)
    return Frame(
        tick, time_s, Status.RUNNING, pose, still, (0.0,) * 4, (3.0, 0.0), None, None, Metrics(),
        message="driving to the goal", exposure=exposure or Exposure(),
    )  # fmt: skip


def following(studio, script):
    """Run `script(service, settled)` on a loop while the service follows; `settled` waits for its rest."""

    async def go():
        service = ExposureService(studio)
        service.follow()

        async def settled():
            await asyncio.sleep(0)
            while service._busy:
                await asyncio.sleep(0.005)

        try:
            await settled()
            return await script(service, settled)
        finally:
            service.close()

    return asyncio.run(go())


def test_an_edit_brings_a_new_picture_that_says_which_edits_it_heeds(studio):
    async def script(service, settled):
        first = service.picture
        studio.update_observer(1, {"x": 4.0})
        await settled()
        return first, service.picture

    first, second = following(studio, script)
    assert (first.edits, second.edits, second.sharp) == (0, 1, True)
    assert not np.array_equal(first.field.seen, second.field.seen)


def test_of_many_edits_in_a_row_the_last_is_shown(studio):
    told = []
    studio.subscribe(lambda change: told.append(change) if change is Change.EXPOSURE else None)

    async def script(service, settled):
        for step in range(30):
            studio.update_observer(1, {"x": 0.1 * step}, drag="one")
        await settled()
        return service.picture

    assert following(studio, script).edits == 30
    assert len(told) <= 4


def test_who_walks_is_followed_in_time(studio, monkeypatch):
    monkeypatch.setattr("app.exposure_service.MOTION_PERIOD_S", 0.0)
    studio.update_observer(1, {"patrol": Patrol(waypoints=(Point(x=8.0, y=8.0),), speed=1.0).model_dump()})

    async def script(service, settled):
        before = service.picture
        studio._drive.frame = frame(6.0)
        studio.tell(Change.FRAME)
        await asyncio.sleep(0.02)
        await settled()
        return before, service.picture

    before, after = following(studio, script)
    assert not np.array_equal(before.field.united, after.field.united)


def test_a_robot_that_drives_past_those_who_stand_costs_nothing(studio):
    async def script(service, settled):
        before = service.picture
        studio._drive.frame = frame(6.0)
        studio.tell(Change.FRAME)
        await asyncio.sleep(0.02)
        await settled()
        return before is service.picture

    assert following(studio, script)


@pytest.mark.parametrize("over", [Over.BEATS, Over.BELIEF])
def test_the_mean_and_the_belief_are_pictures_too(studio, over):
    async def script(service, settled):
        service.show(over)
        await settled()
        return service.picture

    picture = following(studio, script)
    assert picture.over is over and picture.field.united.max() > 0.0


def test_nobody_who_looks_means_no_work(studio):
    async def script(service, settled):
        service.follow(False)
        before = service.picture
        studio.update_observer(1, {"x": 4.0})
        await settled()
        return before is service.picture

    assert following(studio, script)


def test_a_place_is_explained_by_every_observer(studio):
    studio.add_observer(ObserverSpec(x=-8.0, y=-8.0, yaw=-135.0))

    async def script(service, _):
        profiles = await service.profiles(0.0, -2.0)
        with pytest.raises(StudioError, match="map"):
            await service.profiles(99.0, 0.0)
        return profiles

    one, two = following(studio, script)
    assert (one.observer_id, two.observer_id) == (1, 2)
    assert "outside the field of view" in two.reason


BAD = {
    "underground": {"eye_height": 0.0},
    "no range": {"range": 0.0},
    "sees nothing": {"fov_horizontal": 0.0},
    "all round": {"fov_horizontal": 360.0, "fov_vertical": 180.0},
    "on the edge": {"x": 10.0, "y": 10.0},
    "inside the tree": {"x": 0.0, "y": 5.0},
    "a patrol of one point": {"patrol": {"waypoints": [{"x": 0.0, "y": 8.0}]}},
}


@pytest.mark.parametrize("changes", BAD.values(), ids=BAD)
def test_strange_observers_do_no_harm(studio, changes):
    async def script(service, settled):
        studio.update_observer(1, changes)
        await settled()
        return service.picture, await service.profiles(0.0, -2.0)

    picture, (profile,) = following(studio, script)
    assert picture.edits == 1 and np.isfinite(picture.field.united).all() and profile.reason


def test_telemetry_says_which_edits_the_drawn_picture_heeds(studio):
    assert telemetry_document(studio, Revisions(studio))["overlay"] is None
    studio.show_overlay(Overlay(7, True))
    assert telemetry_document(studio, Revisions(studio))["overlay"] == {"edits": 7, "sharp": True}


def test_the_state_in_words_names_who_sees_the_robot(studio):
    drive: Drive = studio._drive
    studio.add_observer(ObserverSpec(x=-8.0, y=-8.0, name="Ridge"))
    drive._scenario, drive.status = studio.scenario, Status.RUNNING
    drive.frame = frame(exposure=Exposure(fraction=0.6, watches=(Watch(1, 0.6), Watch(2, 0.3))))
    assert drive._in_words() == "driving to the goal, seen by observer 1 and Ridge"
    drive.frame = frame(exposure=Exposure(watches=(Watch(1, 0.01),)))
    assert drive._in_words() == "driving to the goal"


def test_a_timeline_keeps_glimpses_and_forgets_what_a_restored_mission_takes_back():
    def row(time_s, fraction):
        return (time_s, *(0.0,) * 8, fraction, 0.5)

    line = Timeline()
    line.extend(row(0.1 * n, 1.0 if n == 77 else 0.0) for n in range(1, 1001))
    times, fraction, probability = line.curves(100)
    assert len(times) <= 100 and fraction.max() == 1.0 and times[-1] == pytest.approx(100.0)
    assert set(probability) == {0.5}
    line.extend([row(50.0, 0.2)])
    assert line.curves(10_000)[0][-1] == 50.0 and len(line) == 500


# routes


@pytest.fixture
def situation(studio) -> Situation:
    scenario = studio.scenario
    return Situation(
        0, studio.heightmap, scenario.cover, scenario.observers, Pose(-3.0, 0.0, 0.0), (3.0, 0.0), 0.0
    )


def test_three_routes_are_compared_by_the_methods_that_follow_them(situation):
    routes = compare(situation).routes
    assert set(routes) == set(CHOICES)
    assert routes["route_shortest"].length_m <= routes["route"].length_m + 1e-6
    assert routes["route"].exposed_s <= routes["route_shortest"].exposed_s + 1e-6


def test_no_route_says_why_and_where(situation, studio):
    for offset in range(-10, 11, 4):
        studio.add_cover(CoverSpec(kind="cottage", x=0.0, y=float(offset), length=5.0, width=2.0, yaw=90.0))
    walled = replace(situation, map_id=1, cover=studio.scenario.cover)
    comparison = compare(walled)
    assert not comparison.routes and "cottage" in comparison.reason and comparison.where is not None


def test_watchers_are_posted_where_they_see_the_way_and_hiding_places_where_nobody_does(situation):
    first, *_ = watchers(situation, None, 2)
    assert first.seen >= SEEN and first.adds == first.seen
    place = hiding_place(situation).points[-1]
    assert abs(place[0]) > 3.0 or place[1] > 7.0, "aside of where observer 1 looks, or behind"
    everywhere = situation.observers[0].model_copy(update={"fov_horizontal": 360.0, "fov_vertical": 180.0})
    open_ground = replace(situation, cover=(), observers=(everywhere,))
    with pytest.raises(NoRoute):
        hiding_place(open_ground)


def test_an_edit_compares_anew_and_another_scenario_forgets(studio, monkeypatch):
    asked = []

    async def answer(self, question, *details):
        asked.append(question.__name__)
        await asyncio.sleep(0)
        return Comparison({})

    monkeypatch.setattr(RouteService, "_ask", answer)

    async def go():
        routes = RouteService(studio)
        studio.update_observer(1, {"x": 1.0})
        assert asked == []
        routes.compare()
        assert routes.working
        await asyncio.sleep(0.02)
        studio.update_observer(1, {"x": 2.0})
        await asyncio.sleep(0.02)
        assert asked == ["compare", "compare"] and routes.comparison is not None
        studio.tell(Change.OPENED)
        assert routes.comparison is None
        with pytest.raises(StudioError, match="between 1 and 8"):
            await routes.watchers(None, 0)

    asyncio.run(go())
