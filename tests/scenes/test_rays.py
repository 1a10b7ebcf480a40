import math
from itertools import pairwise

import numpy as np
import pytest
from grounds import ground, rough, thing
from hypothesis import given
from hypothesis import strategies as st

from scenes.embree import RAYS_WORTH_A_THREAD
from scenes.meshes import cover_mesh, cover_pose, walker_mesh
from scenes.rays import BodyKind, RayScene, near_sphere
from scenes.scenario import MovingObstacle, Observer, Patrol, Point
from scenes.sight import SIGHT_MARGIN
from scenes.terrain import Heightmap

DOWN = np.array([0.0, 0.0, -1.0])
AHEAD = np.array([1.0, 0.0, 0.0])
FLAT = RayScene(ground())


def directions(count: int, seed: int = 0) -> np.ndarray:
    rays = np.random.default_rng(seed).standard_normal((count, 3))
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


@pytest.mark.parametrize(("rows", "columns"), [(20, 20), (9, 31), (40, 12)])
def test_rays_meet_the_ground_where_the_heightmap_says(rows: int, columns: int) -> None:
    heightmap = rough(1, rows, columns, 0.5)
    west, east, south, north = heightmap.bounds
    rng = np.random.default_rng(2)
    x, y = rng.uniform(west, east, 2000), rng.uniform(south, north, 2000)
    eyes = np.column_stack([x, y, np.full(2000, 5.0)])
    hits = RayScene(heightmap).cast(eyes, np.tile(DOWN, (2000, 1)), 10.0)
    assert (hits.body == 0).all()
    np.testing.assert_allclose(5.0 - hits.distance, heightmap.height_at(x, y), atol=1e-5)
    assert (hits.normal[:, 2] > 0.0).all()


def test_a_ray_that_meets_nothing_in_range_is_a_miss() -> None:
    scene = RayScene(ground())
    hits = scene.cast(np.array([0.0, 0.0, 5.0]), np.array([DOWN, -DOWN, DOWN]), 4.9)
    assert (hits.body == -1).all()
    assert np.isinf(hits.distance).all()
    assert not hits.normal.any()
    assert scene.cast(np.array([0.0, 0.0, 5.0]), DOWN[None], 5.1).distance[0] == pytest.approx(5.0)


def first_hit_by_hand(origin, direction, meshes, max_range):
    """Möller and Trumbore's test against every triangle: (distance, mesh index), (inf, -1) for a miss."""
    best = math.inf, -1
    for index, (vertices, faces) in enumerate(meshes):
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        edge_ab, edge_ac, to_origin = b - a, c - a, origin - a
        p = np.cross(direction, edge_ac)
        det = np.einsum("ij,ij->i", edge_ab, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ij,ij->i", to_origin, p) / det
            q = np.cross(to_origin, edge_ab)
            v = q @ direction / det
            t = np.einsum("ij,ij->i", edge_ac, q) / det
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t <= max_range)
        if hit.any() and t[hit].min() < best[0]:
            best = float(t[hit].min()), index
    return best


def test_hits_are_those_of_a_test_against_every_triangle() -> None:
    heightmap = rough(3, 24, 31, 0.5)
    cover = [thing("tree", 2, 1, id=7), thing("cottage", -3, -2, id=8, yaw=30), thing("rock", 0, 4, id=9)]
    walkers = [MovingObstacle(id=4, kind="vehicle", x=1.0, y=-3.5, yaw=75.0)]
    observers = [Observer(id=2, x=-5.0, y=3.0, yaw=-40.0)]
    scene = RayScene(heightmap, cover)
    scene.set_walkers(walkers, observers)
    meshes = [heightmap.triangles()]
    for item in cover:
        mesh = cover_mesh(item)
        meshes.append((cover_pose(heightmap, item).to_world(mesh.vertices), mesh.faces))
    for kind, item in (("vehicle", walkers[0]), ("observer", observers[0])):
        mesh, yaw = walker_mesh(kind), math.radians(item.yaw)
        turn = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
        foot = np.array([item.x, item.y, float(heightmap.height_at(item.x, item.y))])
        meshes.append((mesh.vertices @ turn.T + foot, mesh.faces))
    origin, rays = np.array([0.3, 0.2, 1.4]), directions(600)
    hits = scene.cast(origin, rays, 30.0)
    expected = [first_hit_by_hand(origin, ray, meshes, 30.0) for ray in rays]
    assert set(hits.body) == {-1, 0, 1, 2, 3, 4, 5}
    np.testing.assert_array_equal(hits.body, [body for _, body in expected])
    np.testing.assert_allclose(hits.distance, [distance for distance, _ in expected], atol=1e-4)


def test_bodies_tell_what_was_hit_by_the_things_own_ids() -> None:
    scene = RayScene(ground(), [thing("bush", 3, 0, id=40), thing("fence", -3, 0, id=7)])
    scene.set_walkers([MovingObstacle(id=5, kind="person", x=0.0, y=3.0)], [Observer(id=6, x=0.0, y=-3.0)])
    told = [(body.kind, body.id, body.class_name) for body in scene.bodies]
    assert told == [
        (BodyKind.TERRAIN, 0, "ground"),
        (BodyKind.COVER, 40, "bush"),
        (BodyKind.COVER, 7, "fence"),
        (BodyKind.OBSTACLE, 5, "person"),
        (BodyKind.OBSERVER, 6, "observer"),
    ]
    assert [body.index for body in scene.bodies] == list(range(5))
    assert [body.opacity for body in scene.bodies] == [1.0, 0.8, 0.35, 1.0, 1.0]


def test_walkers_are_where_their_beats_have_them() -> None:
    beat = Patrol(waypoints=(Point(x=8.0, y=0.0),), speed=1.0)
    person = MovingObstacle(id=1, kind="person", x=2.0, y=0.0, patrol=beat)
    scene = RayScene(ground())
    distances = []
    for time_s in (0.0, 1.0, 3.5):
        scene.set_walkers([person], time_s=time_s)
        distances.append(float(scene.cast(np.array([0.0, 0.0, 1.0]), AHEAD[None], 20.0).distance[0]))
    assert distances[0] == pytest.approx(2.0, abs=0.3)
    np.testing.assert_allclose(np.diff(distances), [1.0, 2.5], atol=1e-3)


def test_new_cover_takes_effect_and_walkers_stay() -> None:
    scene = RayScene(ground(), [thing("house", 8, 0)])
    scene.set_walkers([MovingObstacle(id=1, kind="person", x=0.0, y=5.0)])
    eye = np.array([0.0, 0.0, 1.0])
    assert scene.bodies[scene.cast(eye, AHEAD[None], 20.0).body[0]].class_name == "house"
    scene.set_cover([thing("rock", -5, 0), thing("bush", 5, 0, height=2.0)])
    assert scene.bodies[scene.cast(eye, AHEAD[None], 20.0).body[0]].class_name == "bush"
    assert scene.bodies[scene.cast(eye, np.array([[0.0, 1.0, 0.0]]), 20.0).body[0]].class_name == "person"


def test_one_origin_for_all_rays_means_the_same_as_one_each() -> None:
    scene = RayScene(rough(5), [thing("tree", 3, 0)])
    scene.set_walkers([MovingObstacle(id=1, kind="vehicle", x=0.0, y=4.0)])
    eye, rays = np.array([0.1, 0.2, 1.3]), directions(500)
    one, each = scene.cast(eye, rays, 20.0), scene.cast(np.tile(eye, (500, 1)), rays, 20.0)
    np.testing.assert_array_equal(one.distance, each.distance)
    np.testing.assert_array_equal(one.body, each.body)


def test_many_rays_at_once_hit_what_they_hit_one_after_the_other() -> None:
    scene = RayScene(rough(3, 30, 30, 0.5), [thing("tree", 2, 1), thing("rock", -3, 0, id=2)])
    eye, rays = np.array([0.0, 0.0, 3.0]), directions(3 * RAYS_WORTH_A_THREAD)
    at_once, pieces = scene.cast(eye, rays, 50.0), [scene.cast(eye, p, 50.0) for p in np.split(rays, 12)]
    for name in ("distance", "body", "triangle", "normal"):
        np.testing.assert_array_equal(
            getattr(at_once, name), np.concatenate([getattr(p, name) for p in pieces])
        )


def test_every_body_brings_its_colours() -> None:
    scene = RayScene(ground(), [thing("rock", 3, 0), thing("tree", 6, 0, id=2)])
    scene.set_walkers(observers=[Observer(id=1, x=0.0, y=3.0)])
    starts, colours = scene.colours
    sizes = [0, len(cover_mesh(thing("rock", 3, 0)).faces), len(cover_mesh(thing("tree", 6, 0, id=2)).faces)]
    assert list(np.diff(starts)) == sizes
    assert len(colours) == sum(sizes) + len(walker_mesh("observer").faces)
    assert all(begin <= end for begin, end in pairwise(starts))


# --- lines of sight ----------------------------------------------------------------------------------


def see(scene: RayScene, eye, target) -> float:
    return float(scene.visible(np.array(eye, float), np.array(target, float))[0])


@pytest.mark.parametrize(
    ("kind", "light"),
    [("tree", 0.1), ("bush", 0.2), ("rock", 0.0), ("cottage", 0.0), ("disabled_vehicle", 0.0)],
)
def test_cover_lets_through_what_its_opacity_leaves(kind: str, light: float) -> None:
    item = thing(kind, 5, 0, height=4.0, length=4.0, width=3.0)
    mesh = cover_mesh(item)
    # through the middle of the object's upper part, where it is full
    height = 0.6 * float(mesh.bounds[1, 2])
    assert see(RayScene(ground(), [item]), (0, 0, height), (10, 0, height)) == pytest.approx(light)


def test_an_object_counts_once_however_many_surfaces_are_crossed() -> None:
    fence = thing("fence", 5, 0, length=20.0, height=1.2)
    scene = RayScene(ground(), [fence])
    eyes = np.column_stack([np.full(40, -8.0), np.full(40, 0.01), np.linspace(0.05, 1.15, 40)])
    light = scene.visible(eyes, eyes + 26.0 * AHEAD)  # along it, past every post
    assert set(np.round(light, 6)) <= {np.float32(0.65), np.float32(1.0)}
    assert np.mean(light < 1.0) > 0.9


def test_light_is_lost_at_each_of_several_objects() -> None:
    bushes = [thing("bush", x, 0, id=x, height=2.0) for x in (3, 6, 9)]
    assert see(RayScene(ground(), bushes), (0, 0, 1), (12, 0, 1)) == pytest.approx(0.2**3, rel=1e-5)


def test_ground_hides_and_its_crest_does_not_when_looked_over() -> None:
    ridge = RayScene(ground(lambda x, y: 2.0 * np.exp(-(x**2))))
    assert see(ridge, (-8, 0, 1.0), (8, 0, 1.0)) == 0.0
    assert see(ridge, (-8, 0, 2.2), (8, 0, 2.2)) == 1.0


def test_a_tree_before_a_ridge_changes_nothing() -> None:
    ridge = ground(lambda x, y: 2.0 * np.exp(-(x**2)))
    assert see(RayScene(ridge, [thing("tree", -4, 0)]), (-8, 0, 1.0), (8, 0, 1.0)) == 0.0


@given(st.floats(-8, 8), st.floats(-8, 8), st.floats(0.5, 3.0))
def test_the_ground_that_a_target_lies_on_does_not_hide_it(x: float, y: float, height: float) -> None:
    assert see(FLAT, (0.3, -0.2, height), (x, y, 0.0)) == 1.0
    assert see(FLAT, (x, y, 0.0), (0.3, -0.2, height)) == 1.0


def test_within_the_margin_nothing_hides() -> None:
    scene = RayScene(ground(), [thing("rock", 5, 0, height=3.0, length=3.0, width=3.0)])
    eye, ahead = np.array([0.0, 0.0, 1.0]), AHEAD[None]
    face = eye + scene.cast(eye, ahead, 20.0).distance[0] * AHEAD
    assert see(scene, eye, face) == 1.0
    assert see(scene, eye, face + 0.5 * SIGHT_MARGIN * AHEAD) == 1.0
    assert see(scene, eye, face + 3.0 * SIGHT_MARGIN * AHEAD) == 0.0
    assert see(scene, eye, eye) == 1.0


def test_obstacles_hide_and_figures_of_observers_do_not() -> None:
    scene = RayScene(ground())
    scene.set_walkers([MovingObstacle(id=1, kind="vehicle", x=5.0, y=0.0)], [Observer(id=1, x=0.0, y=5.0)])
    assert see(scene, (0, 0, 1), (10, 0, 1)) == 0.0
    assert see(scene, (0, 5, 1.7), (0, 9, 1)) == 1.0
    assert see(scene, (0, 0, 1), (0, 9, 1)) == 1.0


def test_lines_of_sight_are_the_same_both_ways() -> None:
    scene = RayScene(rough(4, relief=0.6), [thing("tree", 3, 1), thing("house", -5, 0, id=2)])
    rng = np.random.default_rng(0)
    eyes, targets = (np.column_stack([rng.uniform(-9, 9, (300, 2)), rng.uniform(0.8, 2, 300)]) for _ in "ab")
    there, back = scene.visible(eyes, targets), scene.visible(targets, eyes)
    assert np.mean(there == back) > 0.99  # float32 rays that graze an edge may differ
    assert set(np.round(np.unique(there), 3)) >= {np.float32(0.0), np.float32(0.1), np.float32(1.0)}


def test_the_same_rays_give_the_same_bits() -> None:
    def cast():
        scene = RayScene(rough(6), [thing("tree", 3, 0), thing("house", -6, 2, id=2)])
        hits = scene.cast(np.array([0.0, 0.0, 1.5]), directions(3000), 50.0)
        return hits.distance.tobytes() + hits.body.tobytes() + hits.normal.tobytes()

    assert cast() == cast()


def test_a_map_with_rows_and_columns_at_the_limit_is_built() -> None:
    zeros = np.zeros((1024, 8), np.uint8)
    heightmap = Heightmap(np.zeros((1024, 8)), 10.0, zeros, zeros)
    hits = RayScene(heightmap).cast(np.array([0.0, 5100.0, 5.0]), DOWN[None], 10.0)
    assert hits.distance[0] == pytest.approx(5.0)


@pytest.mark.parametrize(
    "eye", [(0.0, 0.0, 1.7), (3.0, 1.0, 0.8), (4.0, -4.0, 9.0), (-9.9, 9.9, 1.0), (3.5, 4.0, 0.3)]
)
def test_a_fan_of_lines_from_one_eye_means_the_same_as_lines_one_by_one(eye) -> None:
    """In front of, inside, above and beside things that let light through, on both sides of due west."""
    sheer = [
        thing("bush", 3, 1, height=2.0, length=3.0, width=3.0),
        thing("tree", -4, 0, id=2),
        thing("tree", -5, 0, id=3, height=9.0),
        thing("fence", 3, -3, id=4, length=7.0, yaw=30.0),
        thing("rock", -3, 5, id=5),
    ]
    scene = RayScene(rough(7), sheer)
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-10, 10, 61), np.linspace(-10, 10, 61)))
    targets = np.column_stack([x, y, scene.heightmap.height_at(x, y) + 0.4])
    start = np.array(eye)
    start[2] += scene.heightmap.height_at(*eye[:2])
    fan, single = scene.visible(start, targets), scene.visible(np.tile(start, (len(targets), 1)), targets)
    assert np.count_nonzero(fan != single) <= 3  # single-precision lines that graze an edge
    assert len(np.unique(np.round(fan, 4))) >= 3


@pytest.mark.parametrize("seed", range(6))
def test_rays_near_a_sphere_are_those_of_the_plain_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre, radius = rng.uniform(-5.0, 5.0, 3), rng.uniform(1.0, 3.0)
    ways = directions(500, seed)
    reach = rng.uniform(3.0, 20.0, 500)
    beside = centre + rng.uniform(1.1, 2.0) * radius * directions(1, seed)
    for origins in (rng.uniform(-8.0, 8.0, (500, 3)), beside):
        offset = centre - origins
        along = np.einsum("ij,ij->i", *np.broadcast_arrays(offset, ways))
        aside = np.linalg.norm(offset - along[:, None] * ways, axis=1)
        within = (aside < np.sqrt(1.01) * radius) & (along > -radius) & (along < reach + radius)
        found = near_sphere(origins, ways, reach, centre, radius)
        np.testing.assert_array_equal(found, np.flatnonzero(within))
        assert 0 < len(found) < 500
