"""The layers of a frame: costs on the ground, arcs thinned for drawing, brackets about detections."""

import numpy as np
import pytest

from app.view import palette
from app.view.driving import MAX_ARCS, cost_surface, thinned
from app.view.walkers import sight_outline, sight_sector
from planner.frames import Arcs, CostPatch, Rejection, WalkerPose
from scenes.scenario import Observer
from scenes.terrain import Heightmap


@pytest.fixture
def hill() -> Heightmap:
    y, x = np.mgrid[0:81, 0:81]
    cells = np.zeros((81, 81), np.uint8)
    return Heightmap(np.sin(0.1 * x) + 0.02 * y, 0.25, cells, cells)


def arcs(lengths: np.ndarray, chosen: int) -> Arcs:
    n = len(lengths)
    steps = np.linspace(0.0, 1.0, 6)
    poses = np.zeros((n, 6, 3))
    poses[:, :, 0] = lengths[:, None] * steps
    zeros = np.zeros(n)
    names = ("heading", "clearance", "velocity", "goal", "ground", "total")
    terms = dict.fromkeys(names, zeros)
    return Arcs(v=lengths, w=zeros, poses=poses, rejection=np.zeros(n, np.int8), chosen=chosen, **terms)


def test_the_cost_map_lies_just_above_the_ground_it_speaks_of(hill):
    patch = CostPatch(-3.0, -2.0, 0.5, np.full((9, 13), 40.0, np.float32))
    surface = cost_surface(patch, hill, 1.0)
    assert surface is not None
    x, y, z = surface.vertices.T
    np.testing.assert_allclose(z - hill.height_at(x, y), 0.045, atol=1e-9)
    assert (x.min(), x.max(), y.min(), y.max()) == (-3.0, 3.0, -2.0, 2.0)


def test_unknown_cost_shows_the_ground_and_forbidden_is_darkest():
    rgba = palette.cost_colours(np.array([np.nan, 0.0, 50.0, 100.0, np.inf]))
    assert rgba[0, 3] == 0
    brightness = rgba[1:, :3].sum(axis=1).astype(int)
    assert (np.diff(brightness) < 0).all() and (np.diff(rgba[1:, 3].astype(int)) >= 0).all()


def test_a_patch_that_knows_nothing_or_lies_off_the_map_is_not_drawn(hill):
    unknown = np.full((8, 8), np.nan, np.float32)
    assert cost_surface(CostPatch(0.0, 0.0, 0.25, unknown), hill, 1.0) is None
    assert cost_surface(CostPatch(500.0, 0.0, 0.25, np.zeros((8, 8), np.float32)), hill, 1.0) is None


def test_arcs_are_thinned_to_some_that_move_without_the_chosen_one():
    lengths = np.concatenate([np.zeros(50), np.linspace(0.5, 2.0, 400)])
    shown = thinned(arcs(lengths, chosen=200))
    assert len(shown) <= MAX_ARCS and 200 not in shown
    assert (lengths[shown] > 0).all()
    assert shown[0] == 50 and shown[-1] == 449


def test_every_reason_of_rejection_has_a_colour_and_words():
    reasons = set(Rejection) - {Rejection.NONE}
    assert set(palette.REJECTED) == set(palette.REJECTION_WORDS) == reasons
    assert len(set(palette.REJECTED.values())) == len(reasons)


@pytest.mark.parametrize("known", [True, False])
def test_an_observer_s_sight_is_a_fan_on_the_ground_where_they_look(hill, known):
    observer = Observer(id=1, x=0.0, y=0.0, yaw=90.0, fov_horizontal=60.0, range=6.0, known=known)
    pose = WalkerPose(1, 0.0, 0.0, 0.0, np.pi / 2)
    fan = sight_sector(observer, pose, hill, 0.5, known)
    bearing = np.degrees(np.arctan2(fan.vertices[:, 1], fan.vertices[:, 0]))
    assert bearing.min() >= 59.9 and bearing.max() <= 120.1
    assert np.hypot(*fan.vertices[:, :2].T).max() == pytest.approx(6.0)
    assert fan.colours is not None
    assert tuple(fan.colours[0, :3]) == (palette.SEEN if known else palette.UNKNOWN)


def test_the_fan_is_clear_beyond_the_map(hill):
    observer = Observer(id=1, x=8.0, y=0.0, yaw=0.0, fov_horizontal=360.0, range=40.0)
    fan = sight_sector(observer, WalkerPose(1, 8.0, 0.0, 0.0, 0.0), hill, 1.0)
    assert fan.colours is not None
    outside = np.abs(fan.vertices[:, :2]).max(axis=1) > 10.0 + 1e-6
    assert outside.any() and (fan.colours[outside, 3] == 0).all()


def test_the_outline_ends_at_the_range(hill):
    observer = Observer(id=1, x=0.0, y=0.0, fov_horizontal=90.0, range=5.0)
    outline = sight_outline(observer, WalkerPose(1, 0.0, 0.0, 0.0, 0.0), hill)
    assert np.hypot(*outline[..., :2].reshape(-1, 2).T).max() == pytest.approx(5.0)
