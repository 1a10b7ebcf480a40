"""What stands in a scene: its looks, what of it blocks, where it stands."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small import flat

from scenes.catalogue import CATALOGUE, CoverKind
from scenes.meshes import (
    CollisionBox,
    CollisionCylinder,
    CollisionHull,
    collision_shape,
    cover_mesh,
    cover_pose,
    skirt_depth,
    walker_mesh,
)
from scenes.robot import HUSKY
from scenes.scenario import OBSTACLE_SIZES, CoverObject, CoverSpec
from scenes.terrain import Heightmap

BUILDINGS = (CoverKind.COTTAGE, CoverKind.BUILDING, CoverKind.HOUSE)


def cover(kind: str | CoverKind, **fields) -> CoverSpec:
    return CoverSpec.model_validate({"kind": kind, "x": 0.0, "y": 0.0} | fields)


@st.composite
def cover_of_any_size(draw):
    entry = CATALOGUE[draw(st.sampled_from(CoverKind))]
    sides = {
        side: draw(st.floats(getattr(entry, side).low, getattr(entry, side).high))
        for side in ("length", "width", "height")
    }
    return cover(entry.kind, **sides)


@given(cover_of_any_size())
@settings(max_examples=60)
def test_the_outer_size_is_exact_and_the_mesh_light(thing):
    mesh = cover_mesh(thing)
    low, high = mesh.bounds
    assert high - (*low[:2], 0.0) == pytest.approx(np.array(thing.size), abs=1e-6)
    assert low[:2] == pytest.approx(-high[:2], abs=1e-6)
    assert len(mesh.faces) < 400
    assert np.isfinite(mesh.vertices).all() and (mesh.area_faces > 0.0).all()


@pytest.mark.parametrize("kind", CoverKind)
def test_every_kind_is_coloured(kind):
    colours = cover_mesh(cover(kind)).visual.vertex_colors
    assert (colours[:, 3] == 255).all() and len(np.unique(colours, axis=0)) >= 2


@pytest.mark.parametrize("kind", BUILDINGS)
def test_foundations_reach_a_metre_down(kind):
    assert cover_mesh(cover(kind)).bounds[0, 2] == pytest.approx(-1.0)


@pytest.mark.parametrize("kind", [CoverKind.TREE, CoverKind.FENCE])
def test_trunks_and_posts_reach_half_a_metre_down(kind):
    assert cover_mesh(cover(kind)).bounds[0, 2] == pytest.approx(-0.5)


@pytest.mark.parametrize("kind", CoverKind)
def test_the_same_object_always_looks_the_same_wherever_it_is_moved(kind):
    here, there = cover(kind), cover(kind, x=5.0, y=-3.0, yaw=40.0)
    assert (cover_mesh(here).vertices == cover_mesh(there).vertices).all()


def test_objects_of_one_size_still_differ():
    first, second = (CoverObject(id=number, kind=CoverKind.ROCK, x=0.0, y=0.0) for number in (1, 2))
    a, b = cover_mesh(first).vertices, cover_mesh(second).vertices
    assert a.shape != b.shape or not np.allclose(a, b)


@pytest.mark.parametrize(("length", "height", "conifer"), [(2.0, 7.0, True), (4.0, 6.0, False)])
def test_a_slender_tree_is_a_conifer_and_ends_in_a_point(length, height, conifer):
    mesh = cover_mesh(cover("tree", length=length, width=length, height=height))
    upper = mesh.vertices[mesh.vertices[:, 2] > 0.9 * height]
    assert (len(np.unique(upper.round(6), axis=0)) == 1) is conifer


@pytest.mark.parametrize("height", [2.5, 6.0, 20.0])
def test_the_robot_passes_under_a_crown(height):
    tree = cover("tree", length=3.0, width=3.0, height=height)
    mesh = cover_mesh(tree)
    low = mesh.vertices[mesh.vertices[:, 2] < HUSKY.lidar_mount.z + 0.1]
    assert np.hypot(*low[:, :2].T).max() <= tree.footprint.radius + 1e-6


@given(cover_of_any_size())
@settings(max_examples=60)
def test_what_blocks_in_the_physics_is_the_footprint(thing):
    shape, outline = collision_shape(thing), thing.footprint
    if isinstance(shape, CollisionHull):  # a rock's corners are cut off, as one sees
        low, high = shape.points.min(axis=0), shape.points.max(axis=0)
        assert (outline.distance(shape.points[:, :2]) <= 0.06 * max(thing.size)).all()
        assert -skirt_depth(thing.kind) <= low[2] < 0.0
        top, bottom = high[2], -skirt_depth(thing.kind)
    elif isinstance(shape, CollisionCylinder):
        assert outline.round and 2.0 * shape.radius == pytest.approx(outline.length)
        top, bottom = shape.center[2] + 0.5 * shape.height, shape.center[2] - 0.5 * shape.height
    else:
        assert isinstance(shape, CollisionBox)
        assert 2.0 * np.array(shape.half_extents[:2]) == pytest.approx([outline.length, outline.width])
        top, bottom = shape.center[2] + shape.half_extents[2], shape.center[2] - shape.half_extents[2]
    assert bottom == pytest.approx(-skirt_depth(thing.kind))
    assert top <= thing.height + 1e-9
    if thing.kind is not CoverKind.TREE:
        assert top == pytest.approx(thing.height)


@pytest.mark.parametrize("kind", CoverKind)
def test_on_level_ground_things_stand_on_it(kind):
    pose = cover_pose(flat(height=3.0), cover(kind, x=1.0, y=2.0, yaw=90.0))
    assert (pose.x, pose.y, pose.z, pose.roll, pose.pitch) == (1.0, 2.0, 3.0, 0.0, 0.0)
    assert pose.yaw == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("kind", CoverKind)
def test_on_a_slope_things_stand_upright_and_nowhere_float(kind):
    level = flat(81, 0.25)
    x, _ = level.xy()
    slope = Heightmap(0.3 * x, 0.25, level.surface, level.quality)
    thing = cover(kind, yaw=30.0)
    pose = cover_pose(slope, thing)
    ground = slope.height_at(*thing.footprint.corners.T)
    assert pose.roll == pose.pitch == 0.0
    assert pose.z - skirt_depth(kind) < ground.min()
    assert pose.z <= ground.max()


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        ("person", OBSTACLE_SIZES["person"]),
        ("observer", OBSTACLE_SIZES["person"]),
        ("vehicle", OBSTACLE_SIZES["vehicle"]),
    ],
)
def test_figures_stand_on_the_ground_in_their_size(kind, size):
    mesh = walker_mesh(kind)
    assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-6)
    assert mesh.extents == pytest.approx(size)
    assert len(mesh.faces) < 400
