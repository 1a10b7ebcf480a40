"""Fixtures of the planner's tests."""

import pytest

from planner.mission import Mission


@pytest.fixture
def mission():
    """Makes missions and frees their physics at the end."""
    made = []

    def make(*arguments, **keywords) -> Mission:
        made.append(Mission(*arguments, **keywords))
        return made[-1]

    yield make
    for each in made:
        each.close()
