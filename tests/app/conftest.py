"""Fixtures of the app's tests."""

import pytest
from meadows import meadow_scene

from scenes.scenario import Scenario


@pytest.fixture
def meadow() -> Scenario:
    return meadow_scene()
