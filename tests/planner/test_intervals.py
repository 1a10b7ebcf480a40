"""Intervals are the published ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.intervals import paired_rates, ratio, square_and_add, student, wilson


def test_wilson_matches_published_values():
    # Newcombe 1998, Statistics in Medicine 17, table I, method 3: 81/263 and 15/148
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=5e-5)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_holds_the_rate_and_stays_within_bounds(case):
    successes, trials = case
    low, high = wilson(successes, trials)
    assert 0.0 <= low <= successes / trials + 1e-12 and successes / trials - 1e-12 <= high <= 1.0
    assert low < high


def test_unpaired_rates_match_published_values():
    # Newcombe 1998, Statistics in Medicine 17, 873, table II, method 10: 56/70 less 48/80
    interval = square_and_add(56 / 70, wilson(56, 70), 48 / 80, wilson(48, 80))
    assert interval == pytest.approx((0.0524, 0.3339), abs=5e-5)


def test_paired_rates_match_published_values():
    # Newcombe 1998, Statistics in Medicine 17, 2635, method 10
    assert paired_rates(36, 12, 2, 0) == pytest.approx((0.0569, 0.3404), abs=5e-5)


counts = st.tuples(*[st.integers(0, 60)] * 4).filter(any)


@given(counts)
def test_a_difference_of_rates_lies_in_its_interval_and_turns_with_the_methods(case):
    both, first, second, neither = case
    low, high = paired_rates(both, first, second, neither)
    difference = (first - second) / sum(case)
    assert -1.0 - 1e-9 <= low <= difference + 1e-12 and difference - 1e-12 <= high <= 1.0 + 1e-9
    assert paired_rates(both, second, first, neither) == pytest.approx((-high, -low))


def test_nothing_compared_has_no_interval():
    with pytest.raises(ValueError, match="nothing to compare"):
        paired_rates(0, 0, 0, 0)


def test_student_matches_a_table_and_needs_two_values():
    # t(0.975, 4) = 2.776
    values = [1.0, 2.0, 3.0, 4.0, 5.0]
    half = 2.776 * np.std(values, ddof=1) / np.sqrt(5)
    assert student(values) == pytest.approx((3.0 - half, 3.0 + half), abs=1e-3)
    assert student([1.0]) is None


def test_student_covers_the_mean_as_often_as_it_says():
    rng = np.random.default_rng(4)
    hits = 0
    for _ in range(1000):
        low, high = student(list(rng.normal(7.0, 2.0, 8)))
        hits += low <= 7.0 <= high
    assert 930 <= hits <= 970


def test_a_ratio_of_sums_is_surer_the_more_alike_its_cases_are():
    assert ratio([2.0, 4.0], [4.0, 8.0], 500) == pytest.approx((0.5, 0.5))
    low, high = ratio([0.0, 4.0] * 20, [4.0] * 40, 2000)
    assert low == pytest.approx(0.5 - 1.96 * 0.5 / 40**0.5, abs=0.03)
    assert high == pytest.approx(0.5 + 1.96 * 0.5 / 40**0.5, abs=0.03)
    assert ratio([1.0], [2.0], 500) is None
    assert ratio([1.0, 1.0], [0.0, 2.0], 500) is None, "some draws have nothing to divide by"
