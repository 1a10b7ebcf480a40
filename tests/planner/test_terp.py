"""TERP: its reward, what its network reads, and the published traps that it does not have."""

import math
from dataclasses import replace

import numpy as np
import pytest
from maps import drive, grid_map, percept

from planner.elevation_map import elevation_patch
from planner.environment import CoverNavEnv
from planner.frames import CoverEstimate, Status
from planner.methods import Driving, Learned, make_method
from planner.methods.covernav_paper import PaperConfig
from planner.methods.terp import Terp
from planner.networks import PAPER
from planner.observation import slopes_ahead
from planner.reward import REWARDS, Moment
from scenes.catalogue import CoverKind
from scenes.pose import Pose

ORIGIN = Pose(0.0, 0.0, 0.0)
STANDING = Moment(
    previous_goal_distance=10.0, goal_distance=10.0, previous_heading=0.0, heading=0.0, heading_error=0.0,
    roll=0.0, pitch=0.0, elevation=0.0, previous_elevations=(),
)  # fmt: skip


def wall(x, y):
    return (np.abs(x - 3.0) < 0.2) & (y < 1.5)


class TestReward:
    reward = REWARDS["terp"]

    def test_a_metre_nearer_pays_one(self):
        assert self.reward(replace(STANDING, goal_distance=9.0))["goal"] == 1.0

    @pytest.mark.parametrize(("name", "tilt"), [("roll", 0.4), ("pitch", -0.4)])
    def test_tilting_costs_by_the_squared_cosine(self, name, tilt):
        level, tilted = (self.reward(replace(STANDING, **{name: angle}))["stab"] for angle in (0.0, tilt))
        assert level - tilted == pytest.approx(45.0 / 6000.0 * math.sin(tilt) ** 2)

    def test_facing_away_from_the_goal_costs(self):
        ahead, aside, away = (
            self.reward(replace(STANDING, heading_error=error))["heading"] for error in (0.0, -1.0, math.pi)
        )
        assert ahead == 0.0 > aside > away == pytest.approx(-180.0 * 0.4 / 6000.0)

    def test_slopes_ahead_cost_up_or_down_and_the_near_ones_more(self):
        near, far, down = (
            self.reward(replace(STANDING, slopes_ahead=slopes))["elev"]
            for slopes in ((0.2, 0.0), (0.0, 0.2), (-0.2, 0.0))
        )
        assert near == down < far < 0.0

    def test_cover_and_observers_are_nothing_to_it(self):
        hidden = replace(STANDING, cover_centre=0.1, cover_surface=0.1, shelter=1.0, hidden=1.0)
        assert self.reward(hidden) == self.reward(replace(STANDING, exposure=1.0)) == self.reward(STANDING)

    def test_the_end_replaces_all_else(self):
        closer = replace(STANDING, goal_distance=9.0)
        arrived = self.reward(replace(closer, status=Status.REACHED))
        failed = self.reward(replace(closer, status=Status.COLLIDED))
        assert arrived["total"] == arrived["end"] == -failed["total"] > 0.0 == arrived["goal"]

    def test_the_environment_pays_it(self):
        env = CoverNavEnv("low_high", reward="terp", observers=0, exposure_layer=False, perception="oracle")
        env.reset(seed=3)
        _, paid, *_, info = env.step(np.array([1.0, 0.0], np.float32))
        env.close()
        assert paid == pytest.approx(sum(value for name, value in info["terms"].items() if name != "total"))
        assert info["terms"]["elev"] < 0.0


def test_slopes_ahead_follow_the_heading():
    def hill(x, y):
        return 0.1 * x

    def seen(yaw):
        grid, pose = grid_map(hill), Pose(0.0, 0.0, 0.0, yaw=yaw)
        return slopes_ahead(replace(percept(grid, pose), elevation_patch=elevation_patch(grid, pose)[0]))

    up, down, across = (seen(yaw) for yaw in (0.0, math.pi, 0.5 * math.pi))
    assert up.shape == (20,)
    np.testing.assert_allclose(up[2:-5], 0.1, atol=0.03)
    np.testing.assert_allclose(down[2:-5], -0.1, atol=0.03)
    np.testing.assert_allclose(across[2:-5], 0.0, atol=0.03)


def test_it_is_a_method_with_weights_and_an_exchangeable_motion():
    method = make_method("terp")
    assert isinstance(method, Learned) and method.policy.name == "terp"
    assert isinstance(method, Driving)
    assert method._actor.architecture == PAPER


def test_it_plans_the_same_from_call_to_call():
    given = percept(grid_map(blocked=wall), ORIGIN)
    method = Terp()
    np.testing.assert_array_equal(method.cost(given), method.cost(given))


def test_a_plateau_is_cheap_and_a_pit_is_dear_but_not_as_published():
    row, col = np.mgrid[:40, :40]
    plateau = 2.0 / (1.0 + np.exp(-(col - 24.0)))  # steep at column 24, flat and high beyond
    given = replace(percept(grid_map(), ORIGIN), elevation_patch=plateau.astype(np.float32))
    ours, theirs = (Terp(config=PaperConfig(literal=literal)).cost(given) for literal in (False, True))
    high, bank = (slice(5, 35), slice(33, 38)), (slice(5, 35), slice(23, 26))
    assert ours[high].mean() < 5.0 < 30.0 < ours[bank].mean()
    assert theirs[high].mean() > 5.0 * max(ours[high].mean(), 1.0)
    pit = -2.0 * np.exp(-(((row - 20) ** 2 + (col - 28) ** 2) / 12.0))
    given = replace(given, elevation_patch=pit.astype(np.float32))
    ours, theirs = (Terp(config=PaperConfig(literal=literal)).cost(given) for literal in (False, True))
    rim = np.hypot(row - 20, col - 28).round() == 2
    assert ours[rim].mean() > 30.0
    assert theirs[20, 28] < np.median(theirs)


def test_known_cover_changes_nothing():
    given = percept(grid_map(), ORIGIN)
    house = CoverEstimate(1, CoverKind.HOUSE, 4.0, 0.0, 0.0, 6.0, 4.0, 1.0)
    method = Terp()
    np.testing.assert_array_equal(method.cost(given), method.cost(replace(given, cover=(house,))))


def test_it_goes_round_a_wall():
    now, decision = drive(Terp().decide, grid_map(blocked=wall), ORIGIN)[-1]
    assert now.goal_distance < 0.35 and decision.failure is None
