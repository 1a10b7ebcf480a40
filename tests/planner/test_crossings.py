"""People and vehicles that cross the way: when and where they do, and the suite of missions with them."""

import math

import numpy as np
import pytest

from planner.suites import Knowledge, Suite, suite_mission
from scenes.catalogue import CoverKind
from scenes.crossings import LATENESS, PACE, STARTING_S, WALKS, crossing_scenario, crossing_traffic
from scenes.scenario import CoverObject, Family, ObstacleKind, ScenarioError
from scenes.terrain import Heightmap

WAY = ((-6.0, 0.0), (6.0, 0.0))


def meadow(half=24.0) -> Heightmap:
    flat = np.zeros((round(2 * half) + 1,) * 2)
    return Heightmap(flat, 1.0, flat.astype(np.uint8), flat.astype(np.uint8))


def bush(number, x, y) -> CoverObject:
    return CoverObject(id=number, kind=CoverKind.BUSH, x=x, y=y, length=1.0, width=1.0)


def traffic(seed, cover=(), people=2, vehicles=1):
    return crossing_traffic(np.random.default_rng(seed), meadow(), cover, WAY, people, vehicles)


def when_it_crosses(walker) -> list[tuple[float, float]]:
    """Seconds and metres along the way at which it crosses it, in the first half minute."""
    times = np.arange(0.0, 30.0, 0.02)
    places = np.array([walker.pose_at(t)[:2] for t in times])
    return [
        (times[k], places[k, 0] - WAY[0][0])
        for k in np.flatnonzero(np.diff(np.sign(places[:, 1])) != 0)
        if WAY[0][0] < places[k, 0] < WAY[1][0]
    ]


@pytest.mark.parametrize("seed", range(8))
def test_everyone_crosses_when_a_robot_at_its_usual_pace_comes_by(seed):
    for walker in traffic(seed):
        late = [abs(t - (STARTING_S + along / PACE)) for t, along in when_it_crosses(walker)]
        assert min(late) <= LATENESS + 0.1


@pytest.mark.parametrize("seed", range(8))
def test_beats_are_clear_of_cover_and_of_both_ends_of_the_way(seed):
    cover = tuple(
        bush(k, x, y) for k, (x, y) in enumerate(((-3.0, 2.0), (0.0, -3.0), (3.0, 2.5), (1.0, 5.0)), 1)
    )
    walkers = traffic(seed, cover)
    assert walkers
    for walker in walkers:
        walk = WALKS[walker.kind]
        places = np.array([walker.pose_at(t)[:2] for t in np.arange(0.0, 40.0, 0.1)])
        assert min(thing.footprint.distance(places).min() for thing in cover) > walk.room - 0.05
        assert min(np.hypot(*(places - end).T).min() for end in WAY) > walk.ends - 0.3


def test_speeds_are_those_of_the_kind():
    for seed in range(4):
        for walker in traffic(seed):
            low, high = WALKS[walker.kind].speed
            assert low <= walker.patrol.speed <= high


def test_where_there_is_no_room_nobody_crosses():
    wall = tuple(bush(k, 0.5 * k - 7.0, side) for k in range(1, 28) for side in (-1.2, 1.2))
    assert traffic(0, wall) == ()


def test_the_same_seed_gives_the_same_scene_and_another_another():
    one, same, other = (crossing_scenario("normal", seed).obstacles for seed in (3, 3, 4))
    assert one == same != other


def test_people_and_vehicles_cross_on_generated_ground():
    scenes = [crossing_scenario(family, seed) for family in ("normal", "low") for seed in range(4, 8)]
    kinds = {thing.kind for scene in scenes for thing in scene.obstacles}
    assert kinds == set(ObstacleKind)
    assert all(1 <= len(scene.obstacles) <= 4 for scene in scenes)
    assert all(thing.id == k for scene in scenes for k, thing in enumerate(scene.obstacles, 1))


@pytest.mark.parametrize(("family", "seed"), [("moon", 1), ("normal", -1)])
def test_what_cannot_be_asked_is_refused(family, seed):
    with pytest.raises(ScenarioError):
        crossing_scenario(family, seed)


def test_the_suite_holds_them_with_what_the_best_routes_would_be_seen():
    mission = suite_mission(Suite.CROSSING, Family.NORMAL, 1001, Knowledge.UNKNOWN, 12.0)
    scenario = mission.scenario
    assert scenario.obstacles == crossing_scenario("normal", 1001).obstacles
    assert mission.reference.shortest_m >= math.dist(*[(p.x, p.y) for p in (scenario.start, scenario.goal)])
    assert not any(observer.known for observer in scenario.observers)
