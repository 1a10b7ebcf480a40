"""The paper's learner as a method: cost map, waypoint toward the goal, and weights that are named."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from maps import drive, grid_map, percept

from planner.attention_cost import IMPASSABLE
from planner.checkpoint import save_policy
from planner.learning_errors import PolicyError
from planner.methods import Learned, make_method
from planner.methods.covernav_paper import CoverNavPaper, PaperConfig
from planner.networks import Actor
from scenes.pose import Pose

ORIGIN = Pose(0.0, 0.0, 0.0)


def wall(x, y):
    """Across the way, open on the left."""
    return (np.abs(x - 3.0) < 0.2) & (y < 1.5)


def test_the_registry_does_not_import_torch():
    code = "import sys, planner.methods; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_weights_are_named_with_their_hash():
    method = make_method("covernav_paper")
    assert isinstance(method, Learned)
    assert method.policy.name == "covernav_paper" and len(method.policy.sha256) == 64
    assert not isinstance(make_method("dwa"), Learned)


def test_weights_that_are_no_good_are_refused(tmp_path):
    (tmp_path / "w.safetensors").write_bytes(b"no weights")
    with pytest.raises(PolicyError, match="not a safetensors file"):
        CoverNavPaper(tmp_path / "w.safetensors")


def test_what_stands_on_the_ground_is_barred():
    cost = CoverNavPaper().cost(percept(grid_map(blocked=wall), ORIGIN))
    assert cost[19:21, 25:27].max() == IMPASSABLE  # 3 m ahead
    assert cost[19, 12] == 0.0


def test_a_steep_bank_is_dear_and_the_flat_beside_it_is_not():
    row, col = np.mgrid[:40, :40]
    bank = np.exp(-(((col - 26.0) / 3.0) ** 2)) * (row < 20)
    given = replace(percept(grid_map(), ORIGIN), elevation_patch=bank.astype(np.float32))
    cost = CoverNavPaper().cost(given)
    assert cost[10, 24] > 30.0 > cost[30, 24]


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_a_far_goal_gets_a_waypoint_on_the_side_toward_it(heading):
    given = percept(grid_map(), Pose(0.0, 0.0, 0.0, yaw=heading), goal=(14.0, 3.0))
    decision = CoverNavPaper().decide(given)
    end = decision.route[-1]
    assert 3.4 < np.hypot(*end) < 6.0
    assert float(end @ (14.0, 3.0)) / (np.hypot(*end) * np.hypot(14.0, 3.0)) > 0.7


def test_a_near_goal_is_planned_to_itself():
    decision = CoverNavPaper().decide(percept(grid_map(), ORIGIN, goal=(6.0, 2.0)))
    assert np.hypot(*(decision.route[-1] - (6.0, 2.0))) < 0.5


def test_the_cost_map_lies_where_the_cost_is():
    pose = Pose(0.0, 0.0, 0.0, yaw=0.7)
    patch = CoverNavPaper().decide(percept(grid_map(blocked=wall), pose)).cost
    row, col = round((0.0 - patch.y_min) / patch.resolution), round((3.0 - patch.x_min) / patch.resolution)
    assert np.isinf(patch.cost[row - 1 : row + 1, col - 1 : col + 1]).any()
    assert np.isnan(patch.cost[0, 0])


@pytest.mark.parametrize("literal", [False, True])
def test_it_goes_round_a_wall(literal, tmp_path):
    save_policy(tmp_path / "w.safetensors", Actor())
    method = CoverNavPaper(tmp_path / "w.safetensors", PaperConfig(literal=literal))
    log = drive(method.decide, grid_map(blocked=wall), ORIGIN)
    now, decision = log[-1]
    assert now.goal_distance < 0.35 and decision.failure is None
