"""Which returns are ground: on slopes and rough ground all of it, on things that stand there none."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vlp16 import ground, standing, thing, turn

from planner import ground_segmentation as gs
from scenes.rays import RayScene

SLOPE = math.tan(math.radians(20.0))
GROUNDS = {
    "flat": lambda x, y: 0.0 * x,
    "uphill": lambda x, y: SLOPE * x,
    "downhill": lambda x, y: -SLOPE * x,
    "along the slope": lambda x, y: SLOPE * y,
    "hills": lambda x, y: 1.5 * np.sin(x / 5.0) * np.cos(y / 6.0),
    "rough grass": lambda x, y: np.random.default_rng(3).uniform(-0.03, 0.03, x.shape),
}


def distances(scan):
    """(columns, beams) metres over ground from the sensor; NaN where nothing came back."""
    return np.hypot(*np.moveaxis(scan.points[:, :, :2] - scan.pose_world_sensor.position[:2], -1, 0))


@pytest.mark.parametrize("name", GROUNDS)
def test_bare_ground_is_ground_however_noisy_the_ranges(name):
    heightmap = ground(GROUNDS[name])
    pose = standing(heightmap, 0.0, 0.0, yaw=0.4)
    scan, _ = turn(RayScene(heightmap), pose, sigma=0.03)
    labels, _, _ = gs.segment(scan, pose)
    there = np.isfinite(scan.points[:, :, 2])
    returns, near = labels[there], labels[distances(scan) < gs.GROUND_RANGE - 0.1]
    assert np.mean(near == gs.GROUND) > 0.97
    assert np.mean(returns == gs.STANDING) < 0.001


@pytest.mark.parametrize("name", ["flat", "along the slope", "hills"])
@pytest.mark.parametrize("kind", ["tree", "bush", "rock", "cottage", "disabled_vehicle"])
def test_what_stands_on_the_ground_is_not_ground(kind, name):
    heightmap = ground(GROUNDS[name])
    pose = standing(heightmap, 0.0, 0.0)
    scan, body = turn(RayScene(heightmap, [thing(kind, 6.0, 1.0, yaw=30.0)]), pose, sigma=0.01)
    labels, _, _ = gs.segment(scan, pose)
    on_it = labels[body == 1]
    assert np.sum(on_it == gs.STANDING) > 20
    assert np.mean(on_it == gs.GROUND) < 0.15


def test_a_gap_in_the_returns_leaves_nothing():
    heightmap = ground()
    pose = standing(heightmap, 0.0, 0.0)
    scan, _ = turn(RayScene(heightmap), pose)
    labels, expected, _ = gs.segment(scan, pose)
    missing = np.isnan(scan.points[:, :, 2])
    assert np.all(labels[missing] == gs.NOTHING)
    assert np.all(np.isnan(expected[missing]))


def test_a_robot_lying_on_its_side_expects_level_ground():
    heightmap = ground()
    pose = standing(heightmap, 0.0, 0.0)
    fallen = type(pose)(0.0, 0.0, 0.0, roll=1.5)
    scan, _ = turn(RayScene(heightmap), pose)
    labels, _, _ = gs.segment(scan, fallen)
    assert np.mean(labels[distances(scan) < gs.GROUND_RANGE - 0.1] == gs.GROUND) > 0.99


def plain_segment(points, origin, base, gradient):
    """The rules of the module, point by point on plain lists."""
    labels, expected = np.zeros(points.shape[:2], np.uint8), np.full(points.shape[:2], np.nan)
    for c, column in enumerate(points):
        returns = [
            (i, float(np.hypot(*(p[:2] - origin[:2]))), float(p[2]))
            for i, p in enumerate(column)
            if np.isfinite(p[2])
        ]
        if not returns:
            continue
        first = column[returns[0][0]]
        slope = float((first[:2] - origin[:2]) / returns[0][1] @ gradient)
        start = float(base[2] + (origin[:2] - base[:2]) @ gradient)
        chain, foot, last = [(0.0, start), (gs.FOOT, start + gs.FOOT * slope)], None, None
        for n, (i, d, z) in enumerate(returns):
            end = chain[-1]
            earlier = next((p for p in chain[-2:0:-1] if end[0] - p[0] >= 1.0), chain[0])
            run = end[0] - earlier[0]
            rate = np.clip((end[1] - earlier[1]) / run, -0.4, 0.4) if run > gs.BASELINE else 0.0
            expected[c, i] = end[1] + rate * np.clip(d - end[0], 0.0, gs.LOOK_AHEAD)
            anchor = next((p for p in chain[::-1] if d - p[0] >= gs.BASELINE), chain[0])
            climbs = z - anchor[1] > gs.GROUND_SLOPE * max(d - anchor[0], 0.0) + gs.TOLERANCE
            hidden = foot is not None and z > foot[1] + gs.REGAINED_SLOPE * max(d - foot[0], 0.0) + 0.1
            steep_below = any(
                rise >= gs.RISE and rise > gs.GROUND_SLOPE * (d - r[1]) + gs.TOLERANCE
                for r in returns[:n]
                for rise in [z - r[2]]
            )
            flank = [r for r in returns[n + 1 :] if r[2] - z < 0.3 + 0.05 * d]
            beyond = next((r for r in returns[n + 1 :] if r not in flank), None)
            flank = flank if beyond is None else [r for r in flank if r[0] < beyond[0]]
            steep_above = any(
                r[2] - z >= gs.RISE
                and r[1] - d > -gs.OVERHANG
                and r[2] - z > gs.GROUND_SLOPE * (r[1] - d) + gs.TOLERANCE
                for r in flank
            )
            follows = last is not None and last[0] == i - 1 and last[1] == gs.GROUND
            overlooked = z > end[1] + gs.RISE and d - max(end[0], 2.0) > 1.0 + 0.05 * d * d
            high = z > expected[c, i] + origin[2] - start and not follows
            if climbs or hidden or steep_below:
                label = gs.STANDING
            elif steep_above:
                doubt = gs.EXPECTED_SLOPE * (d - end[0])
                label = gs.STANDING if z - expected[c, i] > gs.RISE + doubt else gs.UNCLEAR
            elif d > gs.GROUND_RANGE or overlooked or high:
                label = gs.UNCLEAR
            else:
                label, foot = gs.GROUND, None
                chain.append((d, z))
            if label == gs.STANDING and foot is None:
                foot = (d, expected[c, i])
            labels[c, i], last = label, (i, label)
    return labels, expected


@given(st.integers(0, 10_000), st.floats(0.05, 1.0))
def test_the_kernel_follows_its_plain_twin(seed, roughness):
    rng = np.random.default_rng(seed)
    distance = np.sort(rng.uniform(1.0, 20.0, (6, 10)), axis=1) + rng.normal(0.0, 0.3, (6, 10))
    azimuth = rng.uniform(-3.0, 3.0, (6, 1))
    height = np.cumsum(rng.normal(0.0, roughness, (6, 10)), axis=1)
    points = np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth), height], axis=-1)
    points[rng.random((6, 10)) < 0.2] = np.nan
    origin, base, gradient = np.array([0.1, 0.0, 0.75]), np.array([0.0, 0.0, 0.05]), rng.normal(0.0, 0.2, 2)
    labels, expected, reach = gs.segment_kernel(points, origin, base, gradient)
    plain_labels, plain_expected = plain_segment(points, origin, base, gradient)
    np.testing.assert_array_equal(labels, plain_labels)
    np.testing.assert_allclose(expected, plain_expected, rtol=0.0, atol=1e-9)
    plain_reach = np.hypot(*np.moveaxis(points[:, :, :2] - origin[:2], -1, 0))
    np.testing.assert_allclose(reach, plain_reach, rtol=1e-12)
