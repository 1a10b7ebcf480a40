"""Why a place is seen or not, in words and as a section."""

import numpy as np
import pytest
from lookouts import ridge, stage, thing, view

from planner.exposure import sight_profile
from scenes.robot import HUSKY
from scenes.scenario import MovingObstacle

WALL = {"length": 1.0, "width": 6.0, "height": 3.0}
BUSH = {"height": 3.0, "length": 3.0, "width": 3.0}


def explained(cover=(), heights=None, at=(-6.0, 0.0), walkers=(), missing=None, **fields):
    heightmap, rays = stage(heights, cover, missing=missing)
    rays.set_walkers(walkers)
    return sight_profile(rays, heightmap, view(heightmap, 6.0, 0.0, **fields), *at)


def test_in_the_open_it_is_seen_and_says_how_far_away():
    profile = explained()
    assert profile.seen and profile.light == 1.0 and profile.blocker is None and profile.point is None
    assert profile.reason == "seen: nothing stands between, 12.1 m away"


def test_behind_a_ridge_the_ground_hides_it_at_a_place_on_the_line():
    profile = explained(heights=ridge, eye_height=1.0)
    assert not profile.seen and profile.light == 0.0
    assert profile.reason.startswith("hidden by the ground, ")
    assert 0.0 < profile.point[0] < 2.0 and profile.point[1] == pytest.approx(0.0)
    along = np.interp(6.0 - profile.point[0], profile.distance, profile.sight)
    assert profile.point[2] == pytest.approx(along, abs=1e-3)


def test_a_thing_that_hides_is_named_with_its_place():
    profile = explained([thing("rock", 0.0, 0.0, id=5, **WALL)])
    assert profile.reason.startswith("hidden by rock 5, 5.") and profile.blocker.id == 5
    assert profile.point[0] == pytest.approx(0.5, abs=0.3)


def test_one_bush_hides_by_what_it_stops():
    profile = explained([thing("bush", 0.0, 0.0, **BUSH)])
    assert not profile.seen and profile.light == pytest.approx(0.2)
    assert "hidden by bush 1, which stops 80% of the light" in profile.reason


def test_fences_let_it_be_seen_until_they_are_too_many():
    fences = [thing("fence", x, 0.0, id=x + 9, yaw=90.0, length=8.0, height=2.5) for x in (-3, 0, 3)]
    once = explained(fences[2:], eye_height=1.2)
    assert once.seen and once.reason == "seen through fence 12: 65% of the light comes through"
    twice = explained(fences, eye_height=1.2)
    assert not twice.seen and "(after fence 12)" in twice.reason and "fence 9" in twice.reason


def test_an_eye_inside_a_thing_is_told_so():
    house = thing("building", 6.0, 0.0, id=4, length=5.0, width=5.0, height=4.0)
    assert explained([house]).reason == "hidden: the observer's eye is inside building 4"
    beside = thing("building", 3.0, 0.0, id=4, length=4.0, width=5.0, height=4.0)
    assert explained([beside]).reason.startswith("hidden by building 4, 1.1 m")


def test_a_person_in_the_way_hides():
    walker = MovingObstacle(id=2, kind="vehicle", x=0.0, y=0.0, yaw=90.0)
    assert explained(walkers=[walker]).reason.startswith("hidden by vehicle 2")


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"range": 10.0}, "out of range: 12.1 m away, the observer sees 10 m"),
        (
            {"fov_horizontal": 90.0},
            "outside the field of view: 180° off the facing, it reaches 45° to each side",
        ),
        ({"fov_vertical": 4.0}, "outside the field of view: 6° below the horizon, it reaches 2°"),
        ({"range": 0.0}, "not seen: the observer's range is 0 m"),
        ({"fov_horizontal": 0.0}, "not seen: the observer's field of view is 0°"),
    ],
)
def test_what_the_observer_does_not_look_at_is_not_seen(fields, reason):
    profile = explained(**fields)
    assert not profile.seen and profile.light == 0.0 and profile.blocker is None
    assert profile.reason == reason


def test_without_data_it_is_unknown():
    missing = np.zeros((41, 41), bool)
    missing[20, 8] = True
    profile = explained(missing=missing)
    assert not profile.seen and profile.reason == "unknown: the survey has no data here"


def test_the_section_runs_from_the_eye_to_the_robots_height():
    profile = explained([thing("cottage", 0.0, 0.0, length=4.0, width=4.0, height=3.0)], heights=ridge)
    assert profile.distance[0] == 0.0 and profile.distance[-1] == pytest.approx(12.0)
    assert profile.sight[[0, -1]] == pytest.approx([profile.eye[2], profile.target[2]])
    assert profile.target[2] == pytest.approx(profile.ground[-1] + HUSKY.height)
    assert profile.ground.max() == pytest.approx(2.0, abs=0.05)
    standing = np.isfinite(profile.cover)
    assert 6 <= standing.sum() * 0.25 * 2 <= 12 and np.all(profile.cover[standing] > profile.ground[standing])
    assert profile.distance[standing].min() == pytest.approx(4.0, abs=0.6)


def test_the_observers_own_cell_can_be_asked_for():
    profile = explained(at=(6.0, 0.0))
    assert profile.seen and np.ptp(profile.distance) == 0.0


def test_a_place_off_the_map_is_refused_in_words():
    with pytest.raises(ValueError, match=r"off the map at \(11, 0\)"):
        explained(at=(11.0, 0.0))
