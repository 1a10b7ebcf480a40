"""A generated scenario in a few hundred bytes: the seed its ground grows from, and who was put there.

A recipe holds a hash of ground, cover, start and goal, so that a scene grown again is the same or refused.
"""

from __future__ import annotations

import hashlib
from typing import Any

from scenes.families import generate
from scenes.scenario import GeneratedSource, MovingObstacle, Observer, Scenario, ScenarioError


def recipe(scenario: Scenario, size_m: float, goal_distance: float) -> dict[str, Any] | None:
    """How to make the scenario again; None where it was not generated."""
    source = scenario.terrain.source
    if not isinstance(source, GeneratedSource):
        return None
    return {
        "name": scenario.name,
        "description": scenario.description,
        "family": source.family.value,
        "seed": source.seed,
        "size_m": size_m,
        "goal_distance": goal_distance,
        "observers": [_short(observer) for observer in scenario.observers],
        "obstacles": [_short(obstacle) for obstacle in scenario.obstacles],
        "land": _land(scenario),
    }


def rebuilt(made: dict[str, Any]) -> Scenario:
    """The scenario of a recipe.

    Raises ScenarioError where the recipe is damaged, or where this version grows another ground."""
    try:
        ends = {"size_m": made["size_m"], "goal_distance": made["goal_distance"]}
        land = generate(made["family"], made["seed"], observers=0, **ends)
        scenario = land.revised(
            name=made["name"],
            description=made["description"],
            observers=tuple(Observer.model_validate(observer) for observer in made["observers"]),
            obstacles=tuple(MovingObstacle.model_validate(obstacle) for obstacle in made["obstacles"]),
        )
        wanted = made["land"]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        reason = " ".join(str(error).split())
        raise ScenarioError(f"the scene's recipe cannot be followed: {reason}") from None
    if _land(scenario) != wanted:
        raise ScenarioError(
            f"{made['name']} was driven on ground that this version does not grow any more; evaluate anew"
        )
    return scenario


def _short(thing: Observer | MovingObstacle) -> dict[str, Any]:
    return thing.model_dump(mode="json", exclude_defaults=True)


def _land(scenario: Scenario) -> str:
    """Short hash of what the generator made."""
    found = hashlib.sha256(scenario.terrain.heights.tobytes())
    found.update(repr((scenario.cover, scenario.start, scenario.goal)).encode())
    return found.hexdigest()[:16]
