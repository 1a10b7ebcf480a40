"""The chance of being noticed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.detection_model import DetectionModel, probability

MODEL = DetectionModel()


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 100.0), st.floats(0.0, 100.0))
def test_more_of_the_robot_and_nearer_is_noticed_sooner(one, other, near, far):
    near, far = sorted((near, far))
    less, more = sorted((one, other))
    assert MODEL.hazard(less, far) <= MODEL.hazard(more, near)
    assert MODEL.hazard(more, near) <= MODEL.rate


def test_the_figures_that_the_documentation_gives():
    assert 1.0 / MODEL.hazard(1.0, 10.0) == pytest.approx(1.3, abs=0.05)
    assert probability(6.0 * MODEL.hazard(1.0, 10.0)) == pytest.approx(0.99, abs=0.005)
    assert 1.0 / MODEL.hazard(1.0, 20.0) == pytest.approx(2.7, abs=0.05)
    assert 1.0 / MODEL.hazard(1.0, 40.0) == pytest.approx(55.0, abs=1.0)


def test_rate_and_distance_can_be_chosen():
    alert = DetectionModel(rate=3.0, distance=5.0)
    np.testing.assert_allclose(alert.hazard([1.0, 0.5], [0.0, 5.0]), [3.0, 1.5 / math.e])
    assert not DetectionModel(rate=0.0).hazard(1.0, 0.0)


@pytest.mark.parametrize(
    "wrong", [{"rate": -1.0}, {"rate": math.nan}, {"distance": 0.0}, {"distance": math.inf}]
)
def test_a_model_that_means_nothing_is_refused(wrong):
    with pytest.raises(ValueError, match="detection must be"):
        DetectionModel(**wrong)
