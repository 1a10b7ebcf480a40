"""What a policy sees: where things are in the layers, and what the numbers of the state say."""

import math
from dataclasses import replace

import numpy as np
import pytest
from field import field, thing

from planner.elevation_map import PATCH_CELLS
from planner.frames import CoverEstimate, Percept, Perception, TrackedObstacle
from planner.observation import (
    HIGH,
    LAYERS,
    LOW,
    STATE_HIGH,
    STATE_LOW,
    STATE_SIZE,
    in_body_frame,
    observe,
    patch_points,
)
from planner.perception import Perceiver
from scenes.catalogue import CoverKind
from scenes.pose import Pose, Twist
from scenes.rays import RayScene
from scenes.scenario import ObstacleKind


def percept(pose=None, **scenario) -> Percept:
    """All that is true of a meadow, from (0, 0) heading east unless told."""
    world = field(**scenario)
    pose = pose or Pose(0.0, 0.0, 0.0)
    rays = RayScene(world.terrain.heightmap(), world.cover)
    perceiver = Perceiver(world, Perception.ORACLE)
    return perceiver.perceive(rays, pose, Twist(), 0.0, (world.goal.x, world.goal.y))


def layer(observation, name: str) -> np.ndarray:
    return observation["layers"][LAYERS.index(name)]


def cell(forward: float, left: float) -> tuple[int, int]:
    """(row, col) of a place in the body frame."""
    return int((left + 10.0) // 0.5), int((forward + 10.0) // 0.5)


def cover(x: float, y: float, width: float = 1.0, height: float = 1.0, kind=CoverKind.ROCK) -> CoverEstimate:
    return CoverEstimate(1, kind, x, y, 0.0, width, height, 0.9)


class TestLayers:
    def test_shapes_and_ranges(self) -> None:
        observation = observe(percept(cover=(thing(x=3.0, y=0.0),)))
        layers, state = observation["layers"], observation["state"]
        assert layers.shape == (6, PATCH_CELLS, PATCH_CELLS) and layers.dtype == np.float32
        assert state.shape == (STATE_SIZE,) and state.dtype == np.float32
        assert (layers >= LOW).all() and (layers <= HIGH).all()
        assert (state >= STATE_LOW).all() and (state <= STATE_HIGH).all()

    def test_elevation_is_the_percepts_within_limits(self) -> None:
        known = percept()
        patch = np.linspace(-9.0, 9.0, 1600, dtype=np.float32).reshape(40, 40)
        seen = layer(observe(replace(known, elevation_patch=patch)), "elevation")
        assert np.array_equal(seen, np.clip(patch, -5.0, 5.0))

    def test_unknown_is_where_elevation_was_filled(self) -> None:
        known = percept()
        assert np.array_equal(layer(observe(known), "unknown"), known.unknown_patch)

    @pytest.mark.parametrize("yaw", [0.0, 0.5 * math.pi, 2.0])
    def test_obstacles_are_where_they_stand_as_the_robot_heads(self, yaw) -> None:
        # 4 m ahead and 2 m to the left of the robot, whichever way it heads
        x, y = Pose(0.0, 0.0, 0.0, yaw=yaw).to_world(np.array([[4.1, 2.1, 0.0]]))[0, :2]
        seen = observe(percept(Pose(0.0, 0.0, 0.0, yaw=yaw), cover=(thing(x=x, y=y),)))
        nearness = layer(seen, "obstacle")
        assert nearness[cell(4.1, 2.1)] == 1.0
        assert 0.0 < nearness[cell(4.1, 0.4)] < 1.0
        assert nearness[cell(-4.1, -2.1)] == 0.0

    def test_nearness_falls_to_nothing_at_two_metres(self) -> None:
        fence = thing(1, "fence", x=5.1, y=0.1, length=0.5, yaw=90.0)
        nearness = layer(observe(percept(goal=(0.0, 9.0), cover=(fence,))), "obstacle")
        toward = nearness[cell(5.1, 0.1)[0], cell(2.6, 0.1)[1] : cell(5.1, 0.1)[1] + 1].tolist()
        assert toward == sorted(toward) and toward[0] == 0.0 and toward[-1] == 1.0

    def test_who_walks_is_an_obstacle_too(self) -> None:
        walker = TrackedObstacle(1, ObstacleKind.PERSON, -3.1, 2.1, 0.0, 0.0, 0.25)
        nearness = layer(observe(replace(percept(), moving=(walker,))), "obstacle")
        assert nearness[cell(-3.1, 2.1)] == 1.0 and nearness[cell(3.1, 2.1)] == 0.0

    def test_cover_is_as_wide_as_it_is_known_to_be_and_as_sure(self) -> None:
        presence = layer(observe(replace(percept(), cover=(cover(4.1, -2.1, width=3.0),))), "cover")
        assert presence[cell(4.1, -2.1)] == pytest.approx(0.9)
        assert presence[cell(4.1, -3.4)] > 0.0 and presence[cell(4.1, -4.6)] == 0.0
        assert presence.sum() == pytest.approx(0.9 * math.pi * 1.5**2 / 0.25, rel=0.2)

    def test_the_smallest_cover_shows(self) -> None:
        presence = layer(observe(replace(percept(), cover=(cover(4.25, 1.25, width=0.7),))), "cover")
        assert presence[cell(4.25, 1.25)] == pytest.approx(0.9)

    @pytest.mark.parametrize("place", [(9.9, 9.9), (-9.9, 3.0), (10.4, 0.0), (0.0, -10.3), (30.0, 0.0)])
    def test_cover_at_the_edge_and_beyond_is_cut_off(self, place) -> None:
        presence = layer(observe(replace(percept(), cover=(cover(*place, width=2.0),))), "cover")
        assert (presence.sum() > 0.0) == (max(map(abs, place)) < 11.0)

    @pytest.mark.parametrize(
        "useless",
        [cover(3.0, 0.0, height=0.2), cover(3.0, 0.0, width=0.4), cover(3.0, 0.0, kind=CoverKind.FENCE)],
        ids=["low", "narrow", "a fence"],
    )
    def test_what_cannot_hide_the_robot_is_no_cover(self, useless) -> None:
        observation = observe(replace(percept(), cover=(useless,)))
        assert not layer(observation, "cover").any() and observation["state"][25] == 1.0

    def test_exposure_and_belief_are_as_given_and_otherwise_none(self) -> None:
        exposure = np.full((40, 40), 0.25)
        exposure[0, 0] = np.nan
        seen = observe(percept(), exposure=exposure)
        assert layer(seen, "exposure")[1, 1] == 0.25 and layer(seen, "exposure")[0, 0] == 0.0
        assert not layer(seen, "belief").any()

    def test_patch_points_are_the_cells_of_the_layers(self) -> None:
        pose = Pose(1.0, -2.0, 0.3, yaw=0.7)
        points = in_body_frame(pose, patch_points(pose)).reshape(40, 40, 2)
        assert points[0, 0] == pytest.approx([-9.75, -9.75])
        assert points[0, 1] == pytest.approx([-9.25, -9.75]), "columns go forward"


class TestState:
    def test_the_goal_by_distance_and_bearing(self) -> None:
        left = observe(percept(goal=(0.0, 6.0)))["state"]
        assert left[0] == pytest.approx(0.5) and left[1] == pytest.approx(0.5)
        behind = observe(percept(Pose(0.0, 0.0, 0.0, yaw=math.pi), goal=(6.0, 0.0)))["state"]
        assert abs(behind[1]) == pytest.approx(1.0)

    def test_tilt_by_its_size(self) -> None:
        state = observe(percept(Pose(0.0, 0.0, 0.0, roll=math.radians(-15.0), pitch=math.radians(30.0))))[
            "state"
        ]
        assert state[2] == pytest.approx(1.0) and state[3] == pytest.approx(0.5)

    def test_heading_change_in_full_turns_of_a_decision(self) -> None:
        assert observe(percept(), heading_change=-0.375)["state"][4] == pytest.approx(-1.0)

    def test_slopes_ahead_are_those_along_the_heading(self) -> None:
        slope = math.tan(math.radians(22.0))
        x = np.linspace(-12.0, 12.0, 97)
        heights = np.tile(slope * np.maximum(x - 4.0, 0.0), (97, 1))
        ahead = observe(percept(heights=heights))["state"][5:25]
        assert ahead[:7] == pytest.approx(np.zeros(7), abs=1e-5)
        assert ahead[10:] == pytest.approx(np.ones(10), abs=0.5) and ahead[10:].mean() == pytest.approx(
            1.0, abs=0.05
        )
        backward = Pose(0.0, 0.0, 0.0, yaw=math.pi)
        assert observe(percept(backward, heights=heights))["state"][5:25] == pytest.approx(
            np.zeros(20), abs=1e-5
        )

    def test_the_nearest_cover_by_its_surface(self) -> None:
        near, far = cover(3.0, 4.0, width=2.0), cover(8.0, 0.0)
        assert observe(replace(percept(), cover=(far, near)))["state"][25] == pytest.approx(0.4)
        assert observe(percept())["state"][25] == 1.0

    def test_how_much_is_seen_now(self) -> None:
        assert observe(percept(), visible=0.75)["state"][26] == 0.75
