"""Fixtures and settings that every floor's tests share."""

from pathlib import Path

import pytest
from hypothesis import settings

# the same examples every time, and no verdict that depends on how busy the machine is
settings.register_profile("studio", deadline=None, derandomize=True)
settings.load_profile("studio")

SURVEY = Path(__file__).parents[2] / "shared" / "data" / "topography.laz"


@pytest.fixture
def survey_file() -> Path:
    """A real airborne survey that lies beside some checkouts."""
    if not SURVEY.exists():
        pytest.skip("the survey is not beside this checkout")
    return SURVEY
