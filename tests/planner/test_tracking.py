"""Tracks of moving obstacles."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vlp16 import ground, standing, turn

from planner.tracking import FORGET_AFTER, ObstacleTracker, Sighted, locate, obstacle_radius
from scenes.rays import RayScene
from scenes.scenario import MovingObstacle, ObstacleKind, Patrol, Point

PERSON, VEHICLE = ObstacleKind.PERSON, ObstacleKind.VEHICLE


def follow(tracker, course, ticks, dt=0.1, begin=0.0, noise=0.0):
    rng, tracks = np.random.default_rng(0), ()
    for tick in range(ticks):
        time_s = begin + dt * tick
        x, y = course(time_s)
        seen = Sighted(1, PERSON, x + noise * rng.normal(), y + noise * rng.normal())
        tracks = tracker.update(time_s, [seen])
    return tracks


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_a_constant_velocity_is_found_within_a_second(vx, vy):
    (track,) = follow(ObstacleTracker(), lambda t: (3.0 + vx * t, 1.0 + vy * t), 11)
    assert (track.vx, track.vy) == (pytest.approx(vx, abs=0.15), pytest.approx(vy, abs=0.15))
    assert (track.x, track.y) == (pytest.approx(3.0 + vx, abs=0.1), pytest.approx(1.0 + vy, abs=0.1))


def test_noise_is_smoothed():
    (track,) = follow(ObstacleTracker(), lambda t: (1.2 * t, 0.0), 60, noise=0.05)
    assert math.hypot(track.vx - 1.2, track.vy) < 0.25


def test_what_is_hidden_moves_on_for_a_second_and_is_then_forgotten():
    tracker = ObstacleTracker()
    (seen,) = follow(tracker, lambda t: (1.0 * t, 0.0), 20)
    (hidden,) = tracker.update(1.9 + 0.5, [])
    assert hidden.x == pytest.approx(seen.x + 0.5 * seen.vx)
    assert tracker.update(1.9 + FORGET_AFTER + 0.01, []) == ()


def test_tracks_are_kept_apart_by_id_and_come_in_its_order():
    tracker = ObstacleTracker()
    tracks = tracker.update(0.0, [Sighted(9, VEHICLE, 5.0, 5.0), Sighted(2, PERSON, 1.0, 1.0)])
    assert [(t.object_id, t.kind, t.x) for t in tracks] == [(2, PERSON, 1.0), (9, VEHICLE, 5.0)]
    assert [t.radius for t in tracks] == [obstacle_radius(PERSON), obstacle_radius(VEHICLE)]


def test_the_radius_holds_the_whole_outline():
    assert obstacle_radius(PERSON) == 0.25
    assert obstacle_radius(VEHICLE) == pytest.approx(0.5 * math.hypot(4.4, 1.9))


def test_a_point_or_two_locate_nothing():
    assert locate(1, PERSON, np.array([[5.0, 0.0, 1.0], [5.0, 0.1, 1.0]]), np.zeros(3)) is None


@pytest.mark.parametrize(("kind", "within"), [(PERSON, 0.15), (VEHICLE, 1.3)])
@pytest.mark.parametrize("bearing", [0.0, 2.0, -1.2])
def test_the_middle_is_found_from_the_near_side(kind, within, bearing):
    heightmap = ground()
    x, y = 7.0 * math.cos(bearing), 7.0 * math.sin(bearing)
    rays = RayScene(heightmap)
    rays.set_walkers([MovingObstacle(id=1, kind=kind, x=x, y=y, yaw=90.0)])
    scan, body = turn(rays, standing(heightmap, 0.0, 0.0), 0.01)
    seen = locate(1, kind, scan.points[body == 1], scan.pose_world_sensor.position)
    assert math.hypot(seen.x - x, seen.y - y) < within


def test_a_walker_is_tracked_along_its_beat():
    heightmap = ground()
    beat = Patrol(waypoints=(Point(x=6.0, y=4.0),), speed=1.2)
    walker = MovingObstacle(id=1, kind=PERSON, x=6.0, y=-4.0, patrol=beat)
    rays, pose, tracker, tracks = RayScene(heightmap), standing(heightmap, 0.0, 0.0), ObstacleTracker(), ()
    for tick in range(15):
        rays.set_walkers([walker], time_s=0.1 * tick)
        scan, body = turn(rays, pose, 0.01, seed=tick)
        seen = locate(1, PERSON, scan.points[body == 1], scan.pose_world_sensor.position)
        tracks = tracker.update(0.1 * tick, [seen])
    x, y, _ = walker.pose_at(1.4)
    assert math.hypot(tracks[0].x - x, tracks[0].y - y) < 0.2
    assert math.hypot(tracks[0].vx, tracks[0].vy - 1.2) < 0.3
