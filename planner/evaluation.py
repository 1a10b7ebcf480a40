"""Methods × terrains × seeds: the same missions for every method, each driven in full physics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Any, get_type_hints

from planner.fingerprint import code_digest
from planner.frames import Perception
from planner.mission import Mission
from planner.posting import Placement
from planner.scene_recipe import recipe
from planner.suites import Knowledge, Suite, size_for, suite_mission
from planner.trajectory import TrajectoryLog
from planner.warm_up import warm_up
from scenes.scenario import Family

ERROR = "error"
"""The status of a mission that could not be driven to its end for a reason of ours."""


@dataclass(frozen=True, order=True)
class MissionSpec:
    """One drive: the mission of `seed` in `terrain` and `suite`, driven by `method`.

    A field with a default may be missing from results of old; what sets rows of the table apart stands in
    `planner.evaluation_table.GROUPED_BY` too.
    """

    terrain: Family
    method: str
    seed: int
    perception: Perception
    goal_distance: float
    suite: Suite = Suite.RANDOM
    observers: Knowledge = Knowledge.KNOWN
    placement: Placement = Placement.UNIFORM

    @classmethod
    def of(cls, result: dict[str, Any]) -> MissionSpec:
        """The spec that a result answers. Raises ValueError, KeyError or TypeError where it answers none."""
        kinds = get_type_hints(cls)
        needed = [field.name for field in fields(cls) if field.default is MISSING or field.name in result]
        return cls(**{name: kinds[name](result[name]) for name in needed})


def drive(spec: MissionSpec) -> dict[str, Any]:
    """Drive one mission: the summary as `run --json`, what it was, under `shortest_...` and `bound_...` what
    the route engine makes of it (`planner.suites.Reference`), which code drove (`planner.fingerprint`), where
    it went, and how to make its scene."""
    warm_up(spec.method, spec.perception)
    set_up = suite_mission(
        spec.suite, spec.terrain, spec.seed, spec.observers, spec.goal_distance, spec.placement
    )
    with Mission(
        set_up.scenario, spec.method, spec.seed, spec.perception, world=set_up.stage, rays=set_up.rays
    ) as mission:
        log = TrajectoryLog()
        log.add(mission.frame)
        for frame in mission.frames():
            log.add(frame)
        found = asdict(spec) | mission.summary() | asdict(set_up.reference) | {"code": code_digest()}
    scene = recipe(set_up.scenario, size_for(spec.goal_distance), spec.goal_distance)
    return found | {"trajectory": log.document(), "scene": scene}


def failed(spec: MissionSpec, reason: str) -> dict[str, Any]:
    """The result of a mission that ended in an error of ours."""
    return asdict(spec) | {"status": ERROR, "success": False, "reason": reason}


def specs(
    methods: Sequence[str],
    terrains: Sequence[Family],
    missions: int,
    seed: int,
    perception: Perception,
    goal_distance: float,
    suite: Suite = Suite.RANDOM,
    observers: Knowledge = Knowledge.KNOWN,
    placement: Placement = Placement.UNIFORM,
) -> list[MissionSpec]:
    """Every mission of an evaluation; mission i has seed + i whatever the method. The methods' drives of one
    mission follow each other, for a process keeps the missions it has made."""
    return [
        MissionSpec(terrain, method, seed + index, perception, goal_distance, suite, observers, placement)
        for terrain in terrains
        for index in range(missions)
        for method in methods
    ]
