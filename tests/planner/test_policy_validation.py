"""The policy that is shipped is the one that does best on missions it was not trained on."""

import pytest

from planner import policy_validation
from planner.checkpoint import PolicyName
from planner.methods.covernav_paper import POLICY
from planner.policy_validation import FIRST_SEED, Validation, best, validate


def result(successes, exposed_s):
    return Validation(PolicyName("p", "0" * 64), 40, successes, (0.0, 1.0), exposed_s, {})


@pytest.mark.parametrize(
    ("results", "index"),
    [
        ([(30, 5.0), (31, 9.0)], 1),
        ([(30, 5.0), (30, 4.0), (30, 4.0)], 1),
        ([(30, 5.0)], 0),
    ],
)
def test_success_counts_first_then_exposure(results, index):
    assert best([result(*each) for each in results]) == index


def test_each_policy_drives_the_same_missions_of_every_terrain(monkeypatch):
    driven = []

    class Drive:
        def __init__(self, scenario, method, seed, *, world, weights):
            driven.append((scenario.terrain.source.family, method, seed, weights))

        def __enter__(self):
            return self

        def __exit__(self, *_): ...

        def frames(self):
            return iter(())

        def summary(self):
            reached = len(driven) % 2 == 0
            return {"success": reached, "status": "reached" if reached else "stuck", "exposed_s": 2.0}

    monkeypatch.setattr(policy_validation, "Mission", Drive)
    found = validate(POLICY, 2)
    assert (found.missions, found.successes, found.exposed_s, found.failures) == (8, 4, 2.0, {"stuck": 4})
    assert [entry[0] for entry in driven] == ["normal"] * 2 + ["low"] * 2 + ["low_high"] * 2 + ["forest"] * 2
    assert {entry[1:] for entry in driven} == {
        ("covernav_paper", FIRST_SEED + index, POLICY) for index in range(2)
    }
