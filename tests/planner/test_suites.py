"""Suites: the same missions for the same seed, reachable, and in `covert` cover matters."""

import math

import numpy as np
import pytest

from planner.covert_route import LONGEST, CovertPlanner
from planner.posting import MOST_WATCHERS, Placement, points_about, posts
from planner.suites import LEAST_SEEN, MOST_LEFT, Knowledge, Suite, suite_mission
from scenes.families import generate
from scenes.rays import BodyKind
from scenes.scenario import Family
from scenes.traversability import reachable

GOAL_DISTANCE = 12.0


@pytest.fixture(scope="module")
def covert():
    return {
        terrain: suite_mission(Suite.COVERT, terrain, 1, Knowledge.KNOWN, GOAL_DISTANCE)
        for terrain in (Family.NORMAL, Family.LOW)
    }


def test_random_missions_are_the_generated_scenes_as_they_come():
    mission = suite_mission(Suite.RANDOM, Family.LOW, 4, Knowledge.KNOWN, GOAL_DISTANCE)
    assert mission.scenario.to_json() == generate(Family.LOW, 4).to_json()
    reference = mission.reference
    assert reference.shortest_m >= GOAL_DISTANCE - 0.5 and reference.bound_s <= reference.shortest_s


def test_on_a_covert_mission_cover_matters(covert):
    for mission in covert.values():
        scenario, reference = mission.scenario, mission.reference
        start, goal = (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)
        planner = CovertPlanner(scenario.terrain.heightmap(), scenario.cover, scenario.observers)
        yaw = math.radians(scenario.start.yaw)
        shortest, hidden = planner.route(start, goal, 0.0, yaw), planner.bound(start, goal, yaw=yaw)
        assert shortest.exposure_fraction >= LEAST_SEEN
        assert hidden.exposed_s <= MOST_LEFT * shortest.exposed_s
        assert hidden.length_m <= LONGEST * shortest.length_m
        assert (reference.shortest_s, reference.bound_s) == (shortest.exposed_s, hidden.exposed_s)


def test_covert_missions_can_be_driven_and_are_watched(covert):
    for mission in covert.values():
        scenario = mission.scenario
        start, goal = (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)
        assert reachable(scenario.terrain.heightmap(), scenario.cover, start, goal)
        assert 1 <= len(scenario.observers) <= MOST_WATCHERS
        assert [observer.id for observer in scenario.observers] == list(range(1, len(scenario.observers) + 1))
        assert all(observer.known for observer in scenario.observers)


def test_a_seed_gives_the_same_mission_again(covert):
    suite_mission.cache_clear()
    again = suite_mission(Suite.COVERT, Family.NORMAL, 1, Knowledge.KNOWN, GOAL_DISTANCE)
    assert again.scenario.to_json() == covert[Family.NORMAL].scenario.to_json()
    assert again.reference == covert[Family.NORMAL].reference


def test_unknown_observers_differ_in_nothing_else(covert):
    known = covert[Family.NORMAL]
    unknown = suite_mission(Suite.COVERT, Family.NORMAL, 1, Knowledge.UNKNOWN, GOAL_DISTANCE)
    assert not any(observer.known for observer in unknown.scenario.observers)
    told = tuple(observer.model_copy(update={"known": True}) for observer in unknown.scenario.observers)
    assert unknown.scenario.revised(observers=told).to_json() == known.scenario.to_json()
    assert unknown.reference == known.reference


@pytest.mark.parametrize("terrain", [Family.NORMAL, Family.FOREST])
def test_watchers_at_vantages_see_more_of_the_way(terrain):
    scenario = generate(terrain, 5, observers=0)
    planner = CovertPlanner(scenario.terrain.heightmap(), scenario.cover, ())
    ends = (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)
    lane = points_about(ends, 1.5, 3.0)
    lane = np.column_stack([lane, scenario.terrain.heightmap().height_at(*lane.T) + 0.3])

    def share_seen(placement: Placement) -> float:
        places = np.vstack(
            [posts(np.random.default_rng(seed), planner, *ends, 24, placement) for seed in range(6)]
        )
        eyes = np.column_stack([places, scenario.terrain.heightmap().height_at(*places.T) + 1.7])
        return float(np.mean([planner.rays.visible(np.broadcast_to(eye, lane.shape), lane) for eye in eyes]))

    assert share_seen(Placement.VANTAGE) > share_seen(Placement.UNIFORM)


@pytest.mark.parametrize("suite", list(Suite))
def test_a_placement_changes_where_watchers_stand_alone(suite):
    def mission(placement: Placement, seed: int = 3):
        return suite_mission(suite, Family.LOW, seed, Knowledge.KNOWN, GOAL_DISTANCE, placement).scenario

    posted = mission(Placement.VANTAGE)
    suite_mission.cache_clear()
    assert posted.to_json() == mission(Placement.VANTAGE).to_json()
    assert posted.observers != mission(Placement.UNIFORM).observers
    if suite is Suite.RANDOM:
        same = mission(Placement.UNIFORM)
        assert posted.cover == same.cover and len(posted.observers) == len(same.observers)


def test_a_far_goal_has_a_map_with_room_for_the_drive_and_a_detour():
    mission = suite_mission(Suite.RANDOM, Family.NORMAL, 2, Knowledge.KNOWN, 50.0)
    start, goal, ground = mission.scenario.start, mission.scenario.goal, mission.rays.heightmap
    assert math.hypot(goal.x - start.x, goal.y - start.y) == pytest.approx(50.0, rel=0.11)
    assert 2.0 * ground.bounds[1] == pytest.approx(80.0, abs=2.0 * ground.resolution)
    assert ground.contains(start.x, start.y) and ground.contains(goal.x, goal.y)
    assert mission.reference.bound_m <= 2.0 * mission.reference.shortest_m


def test_a_missions_rays_are_of_its_own_ground_and_cover():
    mission = suite_mission(Suite.RANDOM, Family.LOW, 4, Knowledge.KNOWN, GOAL_DISTANCE)
    assert np.array_equal(mission.rays.heightmap.heights, mission.scenario.terrain.heightmap().heights)
    standing = [body.id for body in mission.rays.bodies if body.kind is BodyKind.COVER]
    assert standing == [thing.id for thing in mission.scenario.cover]
