"""The map's kernels against plain twins."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import elevation_clearing as ec
from planner import elevation_kernels as ek
from planner.ground_segmentation import GROUND, STANDING, UNCLEAR
from scenes.pose import Pose, wrap_angle

seeds = st.integers(0, 10_000)


def empty(rows=6, cols=7):
    return ek.empty_cells(rows, cols)


def fuse(cells, points, labels, turn=1.0, clearance=0.6):
    expected = np.zeros(labels.shape)
    dry = np.zeros((0, 0), bool)
    distance = np.hypot(points[:, :, 0], points[:, :, 1])
    ek.fuse(cells, points, labels, expected, distance, dry, 0.0, 0.0, 0.5, 0.02, clearance, turn)


@given(seeds)
def test_ground_is_the_weighted_mean_and_spread_of_its_returns(seed):
    rng = np.random.default_rng(seed)
    points = np.stack(
        [rng.uniform(-0.5, 3.5, (8, 5)), rng.uniform(-0.5, 3.0, (8, 5)), rng.uniform(1.0, 1.2, (8, 5))],
        axis=-1,
    )
    labels = rng.choice(np.array([GROUND, UNCLEAR], np.uint8), (8, 5))
    cells = empty()
    fuse(cells, points, labels)
    for row in range(6):
        for col in range(7):
            own = (
                (labels == GROUND)
                & (np.rint(points[:, :, 1] / 0.5) == row)
                & (np.rint(points[:, :, 0] / 0.5) == col)
            )
            cell, z = cells[:, row, col], points[own][:, 2]
            if not own.any():
                assert cell[ek.WEIGHT] == 0.0
                continue
            weight = 1.0 / (0.02 + ek.SIGMA_PER_METRE * np.hypot(*points[own][:, :2].T)) ** 2
            mean = np.average(z, weights=weight)
            assert cell[ek.MEAN] == pytest.approx(mean, abs=1e-9)
            assert cell[ek.SPREAD] == pytest.approx(np.sum(weight * (z - mean) ** 2), abs=1e-6)
            assert cell[ek.WEIGHT] == pytest.approx(weight.sum())
            assert (cell[ek.LOWEST], cell[ek.HIGHEST]) == (z.min(), z.max())


def test_old_ground_counts_for_fifty_returns_at_most():
    cell = ek.EMPTY.copy()
    for _ in range(1000):
        ek.add_ground(cell, 0.0, 1.0 / 0.03**2)
    assert cell[ek.WEIGHT] == ek.MAX_WEIGHT
    for _ in range(200):
        ek.add_ground(cell, 0.2, 1.0 / 0.03**2)
    assert cell[ek.MEAN] == pytest.approx(0.2, abs=0.01)


def test_lower_ground_replaces_what_was_taken_for_ground():
    cell = ek.EMPTY.copy()
    ek.add_ground(cell, 2.0, 100.0)
    ek.add_ground(cell, 0.0, 100.0)
    assert (cell[ek.MEAN], cell[ek.HIGHEST]) == (0.0, 0.0)


def test_returns_far_above_known_ground_stand_on_it():
    cells = empty()
    fuse(
        cells,
        np.array([[[1.0, 1.0, 0.0], [1.0, 1.0, 0.5], [1.0, 1.0, 2.0]]]),
        np.full((1, 3), GROUND, np.uint8),
    )
    cell = cells[:, 2, 2]
    assert cell[ek.MEAN] == 0.0
    assert (cell[ek.FOOT], cell[ek.TOP], cell[ek.EVIDENCE]) == (0.5, 0.5, 1.0)
    assert (cell[ek.HANG], cell[ek.PEAK]) == (2.0, 2.0)


def test_one_scan_adds_so_much_evidence_and_no_more():
    cells = empty()
    points, labels = np.tile([1.0, 1.0, 0.4], (1, 9, 1)), np.full((1, 9), STANDING, np.uint8)
    fuse(cells, points, labels, turn=1.0)
    assert cells[ek.EVIDENCE, 2, 2] == ek.MAX_GAIN
    for turn in range(2, 9):
        fuse(cells, points, labels, turn=float(turn))
    assert cells[ek.EVIDENCE, 2, 2] == ek.MAX_EVIDENCE


def plain_look(points, labels, elevations, origin, offset, low, high, resolution):
    """For a level sensor without yaw: the same question of all beams at once."""
    step, distance = 2 * np.pi / len(points), np.hypot(*offset)
    beams = elevations <= math.atan2(high, distance)
    if np.isfinite(low):
        beams &= elevations >= math.atan2(low, distance)
    middle, aside = round(math.atan2(offset[1], offset[0]) / step), int(0.25 * resolution / distance / step)
    columns = np.arange(middle - aside, middle + aside + 1) % len(points)
    beyond = np.hypot(*np.moveaxis(points[columns][:, beams, :2] - origin[:2], -1, 0)) - distance
    seen = (np.abs(beyond) <= resolution) & (labels[columns][:, beams] != GROUND)
    return seen.any(), np.any((beyond > 0) & ~seen)


def plain_clear(cells, points, labels, elevations, origin, x_min, y_min, resolution, turn):
    cells = cells.copy()
    for row, col in np.ndindex(cells.shape[1:]):
        cell = cells[:, row, col]
        offset = np.array([x_min + col * resolution - origin[0], y_min + row * resolution - origin[1]])
        judged = cell[ek.EVIDENCE] > 0 and cell[ek.TURN] != turn
        asked = (row + turn) % ec.GROUND_TURNS == 0
        if np.hypot(*offset) < resolution or not (judged or (asked and cell[ek.WEIGHT] > 0)):
            continue
        look = (points, labels, elevations, origin, offset)
        if judged:
            low, high = cell[[ek.FOOT, ek.TOP]] + (-0.05, 0.05) - origin[2]
            seen, past = plain_look(*look, low, high, resolution)
            if seen:
                cell[ek.TURN] = turn
            elif past:
                cell[ek.EVIDENCE] = max(cell[ek.EVIDENCE] - ec.SEEN_THROUGH, 0)
        if asked and plain_look(*look, -np.inf, cell[ek.MEAN] - ec.PASSED_BELOW - origin[2], resolution)[1]:
            cell[ek.WEIGHT], cell[[ek.LOWEST, ek.HIGHEST]] = 0.0, np.nan
    return cells


@given(seeds)
def test_clearing_follows_its_plain_twin(seed):
    rng = np.random.default_rng(seed)
    elevations = np.radians(np.linspace(-25.0, 15.0, 8))
    azimuth = 2 * np.pi * np.arange(60)[:, None] / 60
    origin = np.array([1.3, 1.1, 0.75])
    reach = rng.uniform(0.5, 4.0, (60, 8))
    reach[rng.random((60, 8)) < 0.2] = np.nan
    points = origin + np.stack(
        [reach * np.cos(azimuth), reach * np.sin(azimuth), reach * np.tan(elevations)], axis=-1
    )
    labels = rng.choice(np.array([GROUND, STANDING, UNCLEAR], np.uint8), (60, 8))
    cells = empty()
    cells[ek.EVIDENCE] = rng.integers(0, 6, (6, 7))
    cells[ek.WEIGHT] = rng.integers(0, 2, (6, 7))
    cells[ek.MEAN] = rng.uniform(-0.5, 1.0, (6, 7)) * cells[ek.WEIGHT]
    cells[ek.FOOT] = rng.uniform(-0.2, 0.3, (6, 7))
    cells[ek.TOP] = cells[ek.FOOT] + rng.uniform(0.0, 0.6, (6, 7))
    plain = plain_clear(cells, points, labels, elevations, origin, 0.0, 0.0, 0.5, 3.0)
    distance = np.hypot(points[:, :, 0] - origin[0], points[:, :, 1] - origin[1])
    ec.clear_seen_through(cells, distance, labels, elevations, origin, np.eye(3), 0.0, 0.0, 0.5, 3.0)
    np.testing.assert_array_equal(cells, plain)


@given(seeds)
def test_what_no_beam_can_have_met_is_told_without_the_true_angles(seed):
    """A rough no is a true no, however the sensor is turned; and most answers are no."""
    rng = np.random.default_rng(seed)
    elevations, columns = np.radians(np.linspace(-15.0, 15.0, 16)), 120
    reach = rng.uniform(1.0, 12.0, (columns, 1)) + rng.uniform(0.0, 1.0, (columns, 16))
    reach[rng.random(reach.shape) < 0.2] = np.nan
    labels = rng.choice(np.array([GROUND, STANDING], np.uint8), reach.shape)
    rotation = Pose(0.0, 0.0, 0.0, *rng.uniform(-0.3, 0.3, 2), rng.uniform(-math.pi, math.pi)).rotation
    farthest, tangents = ec._farthest(reach), np.tan(elevations - ec._SLACK)
    spared = 0
    for east, north, high in rng.uniform((-12, -12, -2), (12, 12, 1), (60, 3)):
        for low, slack in ((high - 0.5, 0.2), (-np.inf, 0.0)):
            near = ec._may_meet(farthest, tangents, rotation, east, north, high, 0.2, slack)
            seen, past = ec._look(reach, labels, elevations, rotation, east, north, low, high, 0.2)
            assert near or not (past or (seen and slack > 0.0))
            spared += not near
    assert spared > 20


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))
def test_the_rough_azimuth_is_nearly_the_true_one(x, y):
    assert abs(wrap_angle(ec._rough_azimuth(x, y) - math.atan2(y, x))) < 2e-5


@given(seeds)
def test_measured_ground_follows_its_plain_twin(seed):
    rng = np.random.default_rng(seed)
    cells = empty()
    cells[[ek.MEAN, ek.SPREAD, ek.WEIGHT]] = rng.random((3, 6, 7)) * rng.integers(0, 2, (6, 7))
    height, variance = ek.measured_ground(cells)
    known = cells[ek.WEIGHT] > 0
    np.testing.assert_array_equal(height, np.where(known, cells[ek.MEAN], np.nan))
    spread, weight = cells[[ek.SPREAD, ek.WEIGHT]][:, known]
    np.testing.assert_allclose(variance[known], spread / weight + 1 / weight, rtol=1e-12)
    assert np.isnan(variance[~known]).all()


def plain_fill(elevation, variance, resolution, max_gap):
    filled, spread = elevation.copy(), variance.copy()
    for row, col in np.argwhere(np.isnan(elevation)):
        guesses = []
        for heights, doubts, at in (
            (elevation[row], variance[row], col),
            (elevation[:, col], variance[:, col], row),
        ):
            known = np.flatnonzero(np.isfinite(heights))
            before, after = known[known < at], known[known > at]
            if not len(before) or not len(after) or after[0] - before[-1] - 1 > max_gap:
                continue
            ends = [before[-1], after[0]]
            length = float(ends[1] - ends[0])
            doubt = np.interp(at, ends, doubts[ends]) + (ek.FILL_SLOPE * resolution * length) ** 2
            guesses.append((1 / length, np.interp(at, ends, heights[ends]), doubt))
        if guesses:
            weights, heights, doubts = np.array(guesses).T
            filled[row, col] = np.average(heights, weights=weights)
            spread[row, col] = np.average(doubts, weights=weights)
    return filled, spread


@given(seeds, st.floats(0.1, 0.9), st.integers(1, 4))
def test_filling_follows_its_plain_twin(seed, gaps, max_gap):
    rng = np.random.default_rng(seed)
    elevation, variance = rng.normal(size=(9, 8)), rng.uniform(0.0, 0.1, (9, 8))
    elevation[rng.random((9, 8)) < gaps] = np.nan
    for ours, plain in zip(
        ek.fill_gaps(elevation, variance, 0.2, max_gap),
        plain_fill(elevation, variance, 0.2, max_gap),
        strict=True,
    ):
        np.testing.assert_allclose(ours, plain, rtol=0.0, atol=1e-12)


def plain_standing(cells, elevation, clearance, step):
    blocked, overhang = np.zeros(elevation.shape, bool), np.full(elevation.shape, np.inf)
    span = np.stack([np.full(elevation.shape, np.inf), np.full(elevation.shape, -np.inf)])
    known = np.argwhere(np.isfinite(elevation))
    for row, col in np.ndindex(elevation.shape):
        cell = cells[:, row, col]
        stands, hang = cell[ek.EVIDENCE] >= ek.BLOCKS, cell[ek.HANG]
        blocked[row, col] = cell[ek.WATER] > 0
        if not stands and np.isinf(hang):
            continue
        near = [
            ((r - row) ** 2 + (c - col) ** 2, r, c)
            for r, c in known
            if max(abs(r - row), abs(c - col)) <= ek.NEIGHBOURHOOD
        ]
        near = near if stands else [(0, row, col)] if np.isfinite(elevation[row, col]) else []
        ground = elevation[min(near)[1:]] if near else cell[ek.BELOW] if stands else hang - clearance
        if stands and cell[ek.TOP] - ground > step:
            low = cell[ek.FOOT] - ground < clearance
            blocked[row, col] |= low
            hang = hang if low else min(hang, cell[ek.FOOT])
        overhang[row, col] = max(hang - ground, 0.0)
        span[:, row, col] = cell[ek.FOOT] if stands else hang, cell[ek.PEAK]
    return blocked, overhang, span


@given(seeds, st.floats(0.2, 1.0))
def test_judging_what_stands_follows_its_plain_twin(seed, unknown):
    rng = np.random.default_rng(seed)
    shape = (9, 14)
    cells = empty(*shape)
    cells[ek.EVIDENCE] = rng.integers(0, 4, shape)
    cells[ek.FOOT] = rng.uniform(-0.2, 1.0, shape)
    cells[ek.TOP] = cells[ek.FOOT] + rng.uniform(0.0, 1.0, shape)
    cells[ek.BELOW] = rng.uniform(-0.2, 0.2, shape)
    cells[ek.WATER] = rng.integers(-3, 2, shape)
    cells[ek.HANG] = np.where(rng.random(shape) < 0.5, rng.uniform(0.0, 3.0, shape), np.inf)
    cells[ek.PEAK] = cells[ek.TOP] + rng.uniform(0.0, 2.0, shape)
    elevation = np.where(rng.random(shape) < unknown, np.nan, rng.uniform(-0.3, 0.3, shape))
    for ours, plain in zip(
        ek.standing_things(cells, elevation, 0.6, 0.15),
        plain_standing(cells, elevation, 0.6, 0.15),
        strict=True,
    ):
        np.testing.assert_array_equal(ours, plain.astype(ours.dtype))


def plain_steps(elevation, step, slope_rise):
    high = np.zeros(elevation.shape, bool)
    for apart in (1, 2):
        limit = step + apart * slope_rise
        for heights, marks in ((elevation, high), (elevation.T, high.T)):
            rise = heights[apart:] - heights[:-apart]
            marks[apart:] |= rise > limit
            marks[:-apart] |= rise < -limit
    return high


@given(seeds, st.floats(0.0, 0.5))
def test_steps_follow_their_plain_twin(seed, gaps):
    rng = np.random.default_rng(seed)
    elevation = rng.uniform(0.0, 0.6, (10, 9))
    elevation[rng.random((10, 9)) < gaps] = np.nan
    np.testing.assert_array_equal(ek.steps(elevation, 0.15, 0.08), plain_steps(elevation, 0.15, 0.08))
