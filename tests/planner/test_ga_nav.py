"""GA-Nav as a planner: groups on the ground, what they cost, and the drive."""

import json
import math
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from field import field, thing
from hypothesis import given, settings
from hypothesis import strategies as st
from maps import drive, grid_map, percept

from planner.frames import CameraView, Perception, Segmentation
from planner.ga_nav.ground import GroundGroups, GroupCosts, cut_out, project, true_groups
from planner.ga_nav.groups import GROUP_CODE, GROUPS
from planner.ga_nav.images import samples
from planner.ga_nav.learning import Images, score
from planner.ga_nav.network import GaNav, Shape, load_network, save_network
from planner.learning_errors import PolicyError
from planner.methods.ga_nav import POLICY, GaNavPlanner
from planner.perception import Perceiver
from scenes.catalogue import TraversabilityGroup
from scenes.pose import Pose, Twist
from scenes.rays import RayScene
from scenes.scenario import Family
from scenes.sensors import SemanticCamera

BACKGROUND, SMOOTH, ROUGH, BUMPY, FORBIDDEN, OBSTACLE = (GROUP_CODE[group] for group in TraversabilityGroup)
HERE = Pose(0.0, 0.0, 0.0)
FLAT = grid_map()


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A network that has learnt nothing."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("weights") / "none.safetensors"
    save_network(
        path, GaNav(Shape(widths=(8, 8, 16, 16), heads=(1, 1, 2, 2), layers=1, decoder=12, detail=4))
    )
    return path


def view(*cover, pose: Pose = HERE) -> CameraView:
    scenario = field(goal=(-9.0, 0.0), start=(-11.0, 0.0), cover=cover)
    rays = RayScene(scenario.terrain.heightmap(), scenario.cover)
    return CameraView(SemanticCamera().capture(rays, pose, np.random.default_rng(0)), pose)


def said(label: int, sure: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Labels and probabilities that are the same all over a halved image."""
    return np.full((120, 160), label, np.uint8), np.full((120, 160), sure, np.float32)


def cells(layer: GroundGroups, label: int) -> np.ndarray:
    """(n, 2) world x, y of the cells of a label."""
    row, col = np.nonzero(layer.labels == label)
    return np.column_stack([FLAT.x_min + 0.2 * col, FLAT.y_min + 0.2 * row])


# --- on the ground -----------------------------------------------------------------------------------


@settings(max_examples=20)
@given(st.floats(-math.pi, math.pi), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_pixels_lie_where_the_camera_looks(yaw: float, x: float, y: float) -> None:
    pose = Pose(x, y, 0.0, yaw=yaw)
    cell, label, weight = project(view(pose=pose), *said(ROUGH), FLAT)
    assert len(cell) > 100 and (label == ROUGH).all() and (weight > 0.0).all()
    row, col = np.divmod(cell, FLAT.shape[1])
    ahead = np.column_stack([FLAT.x_min + 0.2 * col - x, FLAT.y_min + 0.2 * row - y])
    bearing = np.arctan2(ahead[:, 1], ahead[:, 0]) - yaw
    near = np.hypot(*ahead.T) < 1.0  # where a cell spans a wide angle
    assert (np.abs(np.angle(np.exp(1j * bearing[~near]))) < math.radians(43.5 + 12.0)).all()
    assert np.hypot(*ahead.T).max() < 10.0 / math.cos(math.radians(43.5)) + 0.3


def test_an_image_tells_its_cells_and_no_others() -> None:
    layer = GroundGroups()
    layer.add(view(), *said(SMOOTH), FLAT)
    found = cells(layer, SMOOTH)
    assert len(found) > 300 and found[:, 0].min() > 0.5
    assert (np.abs(np.arctan2(found[:, 1], found[:, 0])) < math.radians(50.0)).all()
    assert set(np.unique(layer.labels)) == {SMOOTH, Segmentation.UNKNOWN}


def test_sky_and_what_hangs_over_the_robot_are_not_on_the_ground() -> None:
    layer = GroundGroups()
    layer.add(view(), *said(BACKGROUND), FLAT)
    assert not layer.labels[layer.labels != Segmentation.UNKNOWN].size
    tree = view(thing(1, "tree", x=5.0, y=0.0, length=5.0, width=5.0, height=8.0))
    layer.add(tree, *said(OBSTACLE), FLAT)
    crown = tree.image.points_body(*np.nonzero(tree.image.body == 1))
    assert (np.hypot(crown[:, 0] - 5.0, crown[:, 1]) > 1.5).any()
    standing = np.where(tree.image.body[::2, ::2] == 1, OBSTACLE, BACKGROUND).astype(np.uint8)
    layer = GroundGroups()
    layer.add(tree, standing, said(0)[1], FLAT)
    found = cells(layer, OBSTACLE)
    assert len(found) and np.hypot(found[:, 0] - 5.0, found[:, 1]).max() < 1.0


def test_later_images_win_over_earlier_ones_and_surer_ones_over_unsure() -> None:
    layer = GroundGroups()
    layer.add(view(), *said(FORBIDDEN), FLAT)
    layer.add(view(), *said(ROUGH, 0.4), FLAT)
    assert len(cells(layer, FORBIDDEN)) and not len(cells(layer, ROUGH))
    for _ in range(2):
        layer.add(view(), *said(ROUGH), FLAT)
    assert len(cells(layer, ROUGH)) and not len(cells(layer, FORBIDDEN))


def test_the_layer_rolls_with_the_map_and_forgets_what_falls_off() -> None:
    layer = GroundGroups()
    layer.add(view(), *said(SMOOTH), FLAT)
    before = layer.labels
    moved = replace(FLAT, x_min=FLAT.x_min + 2.0, y_min=FLAT.y_min - 1.0)
    layer.move_to(moved)
    np.testing.assert_array_equal(layer.labels[5:, :-10], before[:-5, 10:])
    assert (layer.labels[:5] == Segmentation.UNKNOWN).all()
    layer.move_to(replace(FLAT, x_min=FLAT.x_min + 100.0))
    layer.move_to(FLAT)
    assert (layer.labels == Segmentation.UNKNOWN).all()


def test_ground_costs_what_speaks_for_each_group() -> None:
    costs, layer = GroupCosts(), GroundGroups()
    layer.move_to(FLAT)
    assert (layer.cost(costs) == costs.rough).all()
    layer.add(view(), *said(FORBIDDEN), FLAT)
    seen = layer.labels == FORBIDDEN
    assert layer.cost(costs)[seen] == pytest.approx(costs.forbidden, rel=1e-5)
    layer.add(view(), *said(SMOOTH), FLAT)
    mixed = layer.cost(costs)[seen]
    assert ((costs.smooth < mixed) & (mixed < costs.forbidden)).all()
    table = dict(zip(GROUPS, costs.table, strict=True))
    assert table[TraversabilityGroup.SMOOTH] < table[TraversabilityGroup.ROUGH]
    assert table[TraversabilityGroup.ROUGH] < table[TraversabilityGroup.BUMPY]
    assert table[TraversabilityGroup.BUMPY] < table[TraversabilityGroup.OBSTACLE]


def test_the_true_groups_are_the_surfaces_and_what_stands_on_them() -> None:
    scenario = field(cover=(thing(1, "rock", x=3.0, y=3.0), thing(2, "bush", x=-3.0, y=3.0)))
    heightmap = scenario.terrain.heightmap()
    ground = cut_out(true_groups(scenario, heightmap), heightmap, FLAT)
    at = {place: int(ground[FLAT.cell(*place)]) for place in ((3.0, 3.0), (-3.0, 3.0), (0.0, -3.0))}
    assert at == {(3.0, 3.0): BUMPY, (-3.0, 3.0): OBSTACLE, (0.0, -3.0): ROUGH}
    beyond = replace(FLAT, x_min=10.0)
    edge = cut_out(true_groups(scenario, heightmap), heightmap, beyond)
    assert (edge[:, 11:] == Segmentation.UNKNOWN).all() and (edge[:, :10] == ROUGH).all()


# --- the method --------------------------------------------------------------------------------------


def way(method: GaNavPlanner, seen) -> np.ndarray:
    decision = method.decide(seen)
    assert decision.route is not None
    return decision.route


def test_it_goes_around_what_looks_forbidden_on_flat_ground(weights, monkeypatch) -> None:
    look = view()
    middle = np.zeros((120, 160), np.uint8) + ROUGH
    middle[:, 50:110] = FORBIDDEN
    monkeypatch.setattr("planner.methods.ga_nav.segment", lambda network, rgb: (middle, said(0)[1]))
    seen = percept(FLAT, HERE)
    straight = way(GaNavPlanner(weights), seen)
    around = way(GaNavPlanner(weights), replace(seen, view=look))
    assert np.abs(straight[:, 1]).max() < 0.5 < np.abs(around[:, 1]).max()


def test_each_image_is_looked_at_once(weights, monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(
        "planner.methods.ga_nav.segment", lambda network, rgb: asked.append(rgb) or said(ROUGH)
    )
    method, look = GaNavPlanner(weights), view()
    first = method.decide(replace(percept(FLAT, HERE), view=look)).segmentation
    again = method.decide(replace(percept(FLAT, HERE, time_s=0.1), view=look)).segmentation
    assert len(asked) == 1 and again is first
    np.testing.assert_array_equal(first.rgb, look.image.rgb[::2, ::2])
    assert (first.groups == ROUGH).all() and (first.ground == ROUGH).any()
    method.decide(replace(percept(FLAT, HERE, time_s=0.5), view=view()))
    assert len(asked) == 2


def test_in_the_oracles_perception_it_knows_the_true_groups(weights) -> None:
    pond = np.full((97, 97), "g")
    pond[40:57, 56:64] = "w"
    scenario = field()
    scenario = scenario.revised(
        terrain=scenario.terrain.model_copy(update={"surface": tuple("".join(row) for row in pond)})
    )
    method = GaNavPlanner(weights)
    method.brief(scenario, RayScene(scenario.terrain.heightmap()))
    seen = replace(percept(FLAT, HERE), perception=Perception.ORACLE)
    decision = method.decide(seen)
    assert decision.segmentation.rgb is None
    assert decision.segmentation.ground[FLAT.cell(3.0, 0.0)] == FORBIDDEN
    assert np.abs(decision.route[:, 1]).max() > 1.5  # no map tells of the pond here but the groups


def test_it_arrives_without_ever_having_seen_an_image(weights) -> None:
    log = drive(GaNavPlanner(weights).decide, FLAT, HERE)
    assert log[-1][0].goal_distance < 0.35 and log[-1][1].failure is None


def test_a_mission_can_be_gone_on_with_from_a_pickle(weights) -> None:
    method = GaNavPlanner(weights)
    method.decide(replace(percept(FLAT, HERE), view=view()))
    twin = pickle.loads(pickle.dumps(method))
    later = percept(FLAT, HERE, time_s=1.0)
    one, other = method.decide(later), twin.decide(later)
    assert one.command == other.command
    np.testing.assert_array_equal(one.segmentation.ground, other.segmentation.ground)
    assert twin.policy == method.policy


def test_weights_that_are_none_are_refused(tmp_path) -> None:
    (tmp_path / "w.safetensors").write_bytes(b"no weights")
    with pytest.raises(PolicyError, match="not a safetensors file"):
        GaNavPlanner(tmp_path / "w.safetensors")


def test_the_registry_does_not_import_torch_for_it() -> None:
    code = "import sys, planner.methods, planner.ga_nav.ground; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- what is shipped ---------------------------------------------------------------------------------


def test_the_shipped_card_says_how_well_it_tells() -> None:
    card = json.loads(POLICY.with_suffix(".json").read_text())
    assert card["figures"]["test"]["miou"] >= 85.0


def test_what_is_shipped_tells_a_scene_that_it_has_never_seen() -> None:
    network, _ = load_network(POLICY)
    images = samples(Family.LOW, 7500, 6)
    unseen = Images(np.stack([each.rgb for each in images]), np.stack([each.groups for each in images]))
    assert score(network, unseen).accuracy > 0.85


# --- the camera's image in the percept ---------------------------------------------------------------


def test_a_percept_holds_the_newest_image_until_the_camera_looks_again() -> None:
    scenario = field(cover=(thing(1, "bush", x=4.0, y=1.0),))
    rays = RayScene(scenario.terrain.heightmap(), scenario.cover)
    perceiver = Perceiver(scenario, rng=np.random.default_rng(0))
    seen = [perceiver.perceive(rays, HERE, Twist(), 0.1 * tick, (5.0, 0.0)) for tick in range(6)]
    assert seen[0].view is not None and seen[0].view.image.rgb.shape == (240, 320, 3)
    assert all(now.view is seen[0].view for now in seen[:5]) and seen[5].view is not seen[0].view
    assert pickle.loads(pickle.dumps(seen[0])).view is None  # it stays in its process
    assert pickle.loads(pickle.dumps(perceiver))._view is None
