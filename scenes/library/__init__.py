"""Scenarios that come with the studio, one JSON file each."""

from __future__ import annotations

from pathlib import Path

from scenes.scenario import Scenario, ScenarioError

FOLDER = Path(__file__).parent


def shipped() -> dict[str, Path]:
    """Name to file, in alphabetical order."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.json"))}


def load_shipped(name: str) -> Scenario:
    """The shipped scenario of that name. Raises ScenarioError that lists the names where there is none."""
    files = shipped()
    if name not in files:
        raise ScenarioError(f"no shipped scenario is called {name!r}; there are {', '.join(files)}")
    return Scenario.load(files[name])
