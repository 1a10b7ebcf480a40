"""The percept: sensor mode and oracle mode give the same kind of picture, labelled and alike."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vlp16 import standing, thing

from planner.cover import best_cover
from planner.frames import GridMap, Perception
from planner.perception import (
    CAMERA_PERIOD,
    MAX_OBSTACLE_POINTS,
    Perceiver,
    _put_in_order,
    _thinned_depth,
    nearest_points,
    obstacle_distances,
    obstacle_points,
)
from scenes.pose import Pose, Twist
from scenes.rays import RayScene
from scenes.scenario import (
    GeneratedSource,
    MovingObstacle,
    Observer,
    ObstacleKind,
    Patrol,
    Point,
    Scenario,
    Terrain,
)

GOAL = (12.0, 0.0)
LIDAR, ORACLE = Perception.LIDAR, Perception.ORACLE


def scenario(cover=(), obstacles=(), observers=(), water=False) -> Scenario:
    """Flat grass of 40 m, with a pond from x = 5 to 8 m where asked for."""
    cells = 161
    row = "".join("w" if water and 100 <= column < 112 else "g" for column in range(cells))
    terrain = Terrain(
        resolution=0.25,
        heights=np.zeros((cells, cells)),
        surface=(row,) * cells,
        source=GeneratedSource(family="normal", seed=0),
    )
    return Scenario(
        version=1,
        name="field",
        terrain=terrain,
        start={"x": 0.0, "y": 0.0},
        goal={"x": 12.0, "y": 0.0},
        cover=cover,
        obstacles=obstacles,
        observers=observers,
    )


class Robot:
    """A perceiver on a robot that stands or creeps along x."""

    def __init__(self, document: Scenario, perception=LIDAR, seed=0):
        self.document, self.heightmap = document, document.terrain.heightmap()
        self.rays = RayScene(self.heightmap, document.cover)
        self.perceiver = Perceiver(document, perception, np.random.default_rng(seed))
        self.tick = 0

    def look(self, x=0.0, ticks=1):
        for _ in range(ticks):
            time_s = 0.1 * self.tick
            self.rays.set_walkers(self.document.obstacles, self.document.observers, time_s)
            pose = standing(self.heightmap, x, 0.0)
            percept = self.perceiver.perceive(self.rays, pose, Twist(0.1, 0.0), time_s, GOAL)
            self.tick += 1
        return percept


def same(one, other) -> bool:
    """Bit for bit, whatever the objects hold."""
    return pickle.dumps(one) == pickle.dumps(other)


@pytest.mark.parametrize("mode", Perception)
def test_a_percept_says_how_it_was_come_by_and_is_whole(mode):
    percept = Robot(scenario([thing("bush", 5.0, 1.0)]), mode).look()
    assert percept.perception is mode
    assert (percept.pose, percept.twist, percept.goal) == (Pose(0.0, 0.0, 0.0), Twist(0.1, 0.0), GOAL)
    assert percept.elevation_patch.shape == percept.unknown_patch.shape == (40, 40)
    assert np.isfinite(percept.elevation_patch).all()
    assert percept.obstacle_points.shape[1] == 2
    assert percept.obstacle_distances.shape == (72,)


def test_both_modes_map_the_same_cells():
    document = scenario()
    sensed, true = (Robot(document, mode).look().grid for mode in (LIDAR, ORACLE))
    assert (sensed.x_min, sensed.y_min, sensed.resolution, sensed.shape) == (
        true.x_min,
        true.y_min,
        true.resolution,
        true.shape,
    )
    assert np.abs((sensed.elevation - true.elevation)[~sensed.unknown & ~true.unknown]).max() < 0.05


@pytest.mark.parametrize("mode", Perception)
@pytest.mark.parametrize("kind", ["tree", "bush", "rock", "cottage", "disabled_vehicle", "fence"])
def test_both_modes_find_the_way_blocked_where_something_stands(kind, mode):
    percept = Robot(scenario([thing(kind, 5.0, 0.0, yaw=90.0)]), mode).look(ticks=3)
    edge = 5.0 - (0.5 * thing(kind, 5.0, 0.0).footprint.width)
    assert percept.obstacle_distances[0] == pytest.approx(edge, abs=0.45)
    assert np.isinf(percept.obstacle_distances[36])


def test_the_camera_fills_the_ground_ahead_that_the_lidar_overlooks():
    grid = Robot(scenario()).look().grid
    row, col = grid.cell(1.8, 0.0)
    assert not grid.unknown[row, col]
    row, col = grid.cell(-1.8, 0.0)
    assert grid.unknown[row, col]


@pytest.mark.parametrize("mode", Perception)
def test_water_blocks(mode):
    assert Robot(scenario(water=True), mode).look().obstacle_distances[0] == pytest.approx(5.0, abs=0.4)


def test_what_moves_is_tracked_and_kept_out_of_the_map():
    beat = Patrol(waypoints=(Point(x=5.0, y=4.0),), speed=1.0)
    person = MovingObstacle(id=8, kind=ObstacleKind.PERSON, x=5.0, y=-2.0, patrol=beat)
    percept = Robot(scenario(obstacles=[person])).look(ticks=15)
    assert not percept.grid.obstacle.any()
    (track,) = percept.moving
    x, y, _ = person.pose_at(percept.time_s)
    assert (track.object_id, track.kind) == (8, ObstacleKind.PERSON)
    assert math.hypot(track.x - x, track.y - y) < 0.2
    assert track.vy == pytest.approx(1.0, abs=0.3)


def test_an_observer_stands_in_the_way_like_anybody():
    percept = Robot(scenario(observers=[Observer(id=1, x=4.0, y=0.0)])).look(ticks=3)
    assert percept.obstacle_distances[0] == pytest.approx(3.8, abs=0.4)
    assert percept.moving == ()


@pytest.mark.parametrize("mode", Perception)
def test_known_observers_come_with_their_eyes(mode):
    watcher = Observer(id=3, x=9.0, y=9.0, eye_height=2.0)
    percept = Robot(scenario(observers=[watcher]), mode).look()
    assert percept.known_observers == (3,)
    assert percept.observer_eyes == ((9.0, 9.0, 2.0),) and percept.observers == (watcher,)


def test_the_camera_looks_every_fifth_tick_and_its_detections_stand_until_the_next():
    robot = Robot(scenario([thing("cottage", 8.5, 0.0)]))
    frames = [robot.look().detections[0].frame_id for _ in range(2 * CAMERA_PERIOD)]
    assert frames == [0] * CAMERA_PERIOD + [CAMERA_PERIOD] * CAMERA_PERIOD


def test_cover_is_remembered_and_the_oracle_knows_it_all():
    ahead, behind = thing("cottage", 8.5, 0.0, id=1), thing("cottage", -8.5, 0.0, id=2)
    sensed = Robot(scenario([ahead, behind])).look()
    assert [cover.object_id for cover in sensed.cover] == [1]
    true = Robot(scenario([ahead, behind]), ORACLE).look()
    assert [(cover.object_id, cover.confidence) for cover in true.cover] == [(1, 1.0), (2, 1.0)]


def test_the_best_cover_is_chosen_from_what_is_known_at_the_moment():
    bush, house = thing("bush", 5.0, 0.5, id=1), thing("cottage", -6.0, 0.0, id=2)
    assert best_cover(Robot(scenario([bush, house])).look()) == 1
    assert best_cover(Robot(scenario([house])).look()) is None
    assert best_cover(Robot(scenario([house]), ORACLE).look()) == 2


def test_cover_that_is_taken_away_is_forgotten_in_time():
    robot = Robot(scenario([thing("rock", 5.0, 0.0, length=2.0, width=2.0, height=1.5)]))
    assert robot.look(ticks=10).cover
    assert robot.look().obstacle_distances[0] < 5.0
    robot.document = scenario()
    robot.rays.set_cover(())
    robot.perceiver.edit(robot.document)
    percept = robot.look(ticks=30)
    assert not percept.cover
    assert np.isinf(percept.obstacle_distances[0])


def test_an_edit_shows_to_the_oracle_at_once():
    robot = Robot(scenario([thing("rock", 5.0, 0.0)]), ORACLE)
    assert robot.look().obstacle_distances[0] < 5.0
    robot.perceiver.edit(scenario())
    assert np.isinf(robot.look().obstacle_distances[0])


def test_the_mode_can_be_switched_and_back_without_forgetting():
    robot = Robot(scenario([thing("cottage", 8.5, 0.0)]))
    before = robot.look()
    robot.perceiver.perception = ORACLE
    assert robot.look().perception is ORACLE
    assert robot.perceiver.cloud is None
    robot.perceiver.perception = LIDAR
    after = robot.look()
    assert after.cover == before.cover
    assert (~after.grid.unknown).sum() >= (~before.grid.unknown).sum()


def test_the_same_seed_gives_the_same_percepts_and_another_does_not():
    document = scenario([thing("bush", 6.0, 1.0)])
    one, other, third = (Robot(document, seed=seed).look(ticks=7) for seed in (4, 4, 5))
    assert same(one, other)
    assert not same(one, third)


def test_a_perceiver_goes_on_from_a_pickle_as_if_nothing_had_happened():
    document = scenario([thing("bush", 6.0, 1.0)])
    kept, moved = Robot(document), Robot(document)
    kept.look(ticks=7)
    moved.look(ticks=7)
    moved.perceiver = pickle.loads(pickle.dumps(moved.perceiver))
    assert same(kept.look(ticks=4), moved.look(ticks=4))


def grid_of(obstacle: np.ndarray) -> GridMap:
    zeros = np.zeros(obstacle.shape, np.float32)
    return GridMap(-1.0, -2.0, 0.5, zeros, zeros, obstacle, zeros, zeros)


def test_obstacle_points_are_the_rims_of_obstacles():
    obstacle = np.zeros((8, 9), bool)
    obstacle[1:6, 2:7] = True
    points = obstacle_points(grid_of(obstacle))
    assert len(points) == 25 - 9
    assert points.min(axis=0).tolist() == [0.0, -1.5]
    assert points.max(axis=0).tolist() == [2.0, 0.5]


@pytest.mark.parametrize("share", [0.05, 0.5, 0.9, 1.0])
def test_rims_are_those_of_a_plain_twin(share):
    obstacle = np.random.default_rng(0).random((23, 31)) < share
    inner = np.zeros_like(obstacle)
    inner[1:-1, 1:-1] = obstacle[:-2, 1:-1] & obstacle[2:, 1:-1] & obstacle[1:-1, :-2] & obstacle[1:-1, 2:]
    row, col = np.nonzero(obstacle & ~inner)
    expected = np.column_stack([-1.0 + 0.5 * col, -2.0 + 0.5 * row])
    assert np.array_equal(obstacle_points(grid_of(obstacle)), expected)


def test_no_obstacles_give_no_points():
    points = obstacle_points(grid_of(np.zeros((8, 9), bool)))
    pose = Pose(0.0, 0.0, 0.0)
    assert nearest_points(points, pose).shape == (0, 2)
    assert np.isinf(obstacle_distances(points, pose)).all()


places = st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)), min_size=1, max_size=30)


@given(places, st.floats(-3.0, 3.0), st.floats(-math.pi, math.pi))
def test_distances_by_bearing_are_those_of_the_nearest_point_there(found, x, yaw):
    points, pose = np.array(found), Pose(x, 0.5, 0.0, yaw=yaw)
    distances = obstacle_distances(points, pose)
    assert distances.min() == pytest.approx(np.hypot(points[:, 0] - x, points[:, 1] - 0.5).min())
    for k in np.flatnonzero(np.isfinite(distances)):
        bearing = yaw + math.radians(5.0 * k)
        end = np.array([x, 0.5]) + distances[k] * np.array([math.cos(bearing), math.sin(bearing)])
        assert np.hypot(*(points - end).T).min() <= distances[k] * math.radians(2.51) + 1e-9


@given(places)
def test_points_near_the_robot_come_nearest_first_and_not_without_limit(found):
    points, pose = np.array(found), Pose(0.0, 0.0, 0.0)
    near = nearest_points(points, pose, reach=6.0, limit=5)
    distance = np.hypot(near[:, 0], near[:, 1])
    assert np.all(np.diff(distance) >= 0.0) and np.all(distance <= 6.0)
    assert len(near) == min(5, (np.hypot(points[:, 0], points[:, 1]) <= 6.0).sum())
    assert len(nearest_points(np.zeros((1000, 2)), pose)) == MAX_OBSTACLE_POINTS


@given(st.integers(0, 2**32 - 1))
def test_a_turn_is_put_in_order_as_its_plain_twin_does(seed):
    rng = np.random.default_rng(seed)
    rays = rng.permutation(24)[: rng.integers(0, 25)]
    column, beam = rays // 4, rays % 4
    world, body = rng.normal(size=(len(rays), 3)), rng.integers(0, 3, len(rays))
    still = np.array([True, False, True, False])
    points, plain = np.full((6, 4, 3), np.nan), np.full((6, 4, 3), np.nan)
    stays = still[body]
    plain[column[stays], beam[stays]] = world[stays]
    _put_in_order(points, world, still, body, column, beam)
    np.testing.assert_array_equal(points, plain)


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_a_depth_image_is_thinned_as_its_plain_twin_does(seed, stride):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 9, 2))
    depth = rng.uniform(0.5, 20.0, shape).astype(np.float32)
    body, surface = rng.integers(-1, 3, shape), rng.integers(0, 3, shape)
    still, (fx, fy, cx, cy) = np.array([True, False, True, False]), (5.0, 6.0, 3.5, 2.5)
    row, col = np.arange(shape[0])[::-1][::stride], np.arange(shape[1])[::stride]
    pick = np.ix_(row, col)
    ahead = np.where((depth[pick] <= 12.0) & still[body[pick]], depth[pick].astype(float), np.nan)
    plain = np.stack([ahead, ahead * (cx - col) / fx, ahead * (cy - row)[:, None] / fy], -1)
    points, wet = _thinned_depth(
        depth, body, surface, still, np.array([fx, fy, cx, cy]), stride, np.float32(12.0), 1
    )
    np.testing.assert_allclose(points, plain.swapaxes(0, 1), rtol=1e-12)
    np.testing.assert_array_equal(wet, (surface[pick] == 1).T)
