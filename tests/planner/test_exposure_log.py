"""What a drive's exposure adds up to."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookouts import ground, view

from planner.detection_model import DetectionModel
from planner.exposure_log import NOTICEABLE, ExposureLog
from planner.line_of_sight import VisibleFraction
from scenes.pose import Pose
from scenes.robot import HUSKY

FLAT = ground()
WEST, EAST = view(FLAT, -6.0, 0.0, id=1), view(FLAT, 8.0, 0.0, id=2)
HERE = Pose(0.0, 0.0, 0.0)
STEADY = DetectionModel(rate=0.2, distance=1e9)  # the same at any distance


def logged(*ticks, seconds=0.1, model=STEADY) -> ExposureLog:
    """A tick for each pair of fractions, of the west and the east."""
    log, views = ExposureLog(), tuple(replace(view, detection=model) for view in (WEST, EAST))
    for west, east in ticks:
        log.add(seconds, views, VisibleFraction(max(west, east), np.array([west, east])), HERE)
    return log


def test_before_anything_has_happened_all_is_nought():
    now = ExposureLog().exposure
    assert now.fraction == now.exposed_s == now.exposure_fraction == now.concealed_fraction == 0.0
    assert now.detection_probability == 0.0 and now.expected_detection_s is None and now.watches == ()


def test_half_seen_for_two_seconds_is_one_exposed_second():
    now = logged(*[(0.5, 0.0)] * 20, *[(0.0, 0.0)] * 20).exposure
    assert now.exposed_s == pytest.approx(1.0) and now.exposure_fraction == pytest.approx(0.25)
    assert now.concealed_fraction == pytest.approx(0.5) and now.fraction == 0.0


def test_seen_by_two_at_once_counts_once_but_for_each_of_them():
    now = logged(*[(1.0, 0.0)] * 10, *[(0.6, 1.0)] * 10).exposure
    assert now.exposed_s == pytest.approx(2.0)
    west, east = now.watches
    assert (west.observer_id, east.observer_id) == (1, 2)
    assert (west.exposed_s, east.exposed_s) == pytest.approx((1.6, 1.0))
    assert (west.exposure_fraction, east.fraction) == pytest.approx((0.8, 1.0))


def test_the_longest_exposure_goes_on_from_one_observer_to_the_next():
    ticks = [(1.0, 0.0)] * 5 + [(0.0, 0.4)] * 6 + [(NOTICEABLE, 0.0)] + [(0.0, 1.0)] * 4
    now = logged(*ticks).exposure
    assert now.longest_exposure_s == pytest.approx(1.1)
    assert [watch.longest_exposure_s for watch in now.watches] == pytest.approx([0.5, 0.6])


def test_independent_watchers_detect_by_their_summed_rates():
    now = logged(*[(1.0, 1.0)] * 30).exposure
    assert now.detection_probability == pytest.approx(1.0 - math.exp(-0.2 * 2 * 3.0))
    assert [watch.detection_probability for watch in now.watches] == pytest.approx([1.0 - math.exp(-0.6)] * 2)


def test_far_watchers_detect_less():
    now = logged(*[(1.0, 1.0)] * 10, model=DetectionModel(rate=1.0, distance=5.0)).exposure
    heights = WEST.z - 0.5 * HUSKY.height
    expected = [1.0 - math.exp(-math.exp(-(x**2 + heights**2) / 25.0)) for x in (6.0, 8.0)]
    assert [watch.detection_probability for watch in now.watches] == pytest.approx(expected)


@given(st.lists(st.integers(0, 12).map(lambda points: points / 12), min_size=1, max_size=60))
def test_the_expected_time_is_the_mean_of_the_moments_of_detection(fractions):
    """Against the sum over ticks, written out."""
    log = logged(*[(fraction, 0.0) for fraction in fractions], model=DetectionModel(2.0, 1e9))
    survival = np.exp(-np.cumsum([0.0, *(0.2 * fraction for fraction in fractions)]))
    caught = -np.diff(survival)
    middle = 0.1 * (np.arange(len(fractions)) + 0.5)
    now = log.exposure
    if now.expected_detection_s is None:
        assert max(fractions) == 0.0
    else:
        assert now.expected_detection_s == pytest.approx((middle * caught).sum() / caught.sum(), rel=1e-6)
        assert now.detection_probability == pytest.approx(caught.sum(), rel=1e-6)


def test_an_observer_who_is_taken_away_keeps_what_it_saw():
    log = logged((1.0, 1.0))
    log.add(0.1, (WEST,), VisibleFraction(0.5, np.array([0.5])), HERE)
    west, east = log.exposure.watches
    assert (west.fraction, east.fraction) == (0.5, 0.0) and east.exposed_s == pytest.approx(0.1)


def test_a_look_without_time_counts_nothing():
    now = logged((0.7, 0.0), seconds=0.0).exposure
    assert now.fraction == 0.7 and now.exposed_s == now.exposure_fraction == now.longest_exposure_s == 0.0


def test_the_summary_is_flat_and_names_each_observer():
    log = logged(*[(1.0, 0.0)] * 10)
    assert log.summary() == {
        "exposure_fraction": pytest.approx(1.0),
        "exposed_s": pytest.approx(1.0),
        "longest_exposure_s": pytest.approx(1.0),
        "detection_probability": pytest.approx(1.0 - math.exp(-0.2)),
    }
    details = log.details()
    assert details["concealed_fraction"] == 0.0 and 0.0 < details["expected_detection_s"] < 1.0
    assert [each["observer_id"] for each in details["by_observer"]] == [1, 2]
    assert set(details["by_observer"][0]) == {"observer_id", *log.summary()}


def test_an_observer_with_field_glasses_notices_sooner():
    def detected(**fields) -> float:
        watcher = view(FLAT, -30.0, 0.0, id=1, range=100.0, **fields)
        log = ExposureLog()
        log.add(5.0, (watcher,), VisibleFraction(1.0, np.array([1.0])), HERE)
        return log.exposure.detection_probability

    assert detected() < 0.5 < detected(detection_distance=80.0)
    assert detected(detection_rate=0.0) == 0.0
