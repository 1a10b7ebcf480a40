"""How an arc of the dynamic window is chosen: by its own weighted terms, or by a learned policy."""

from __future__ import annotations

from typing import Protocol

from planner.dwa import NO_SLIP, DwaConfig, Rollout, Slip, Surroundings, candidates, evaluate
from planner.frames import Percept

MOTIONS = ("dwa", "dwa_rl")
"""The names there are; the first is the usual one."""


class Motion(Protocol):
    """Chooses among the arcs that the robot can reach; may remember what it sees."""

    name: str

    def see(self, percept: Percept) -> None:
        """Once a tick, whoever drives."""
        ...

    def arcs(
        self,
        config: DwaConfig,
        percept: Percept,
        target: tuple[float, float],
        around: Surroundings,
        max_speed: float,
        slip: Slip = NO_SLIP,
    ) -> Rollout:
        """The window's arcs toward `target` (world), one of the admissible ones chosen, -1 where none is."""
        ...

    def reset(self) -> None:
        """Forget what was seen, as for a new goal."""
        ...


class WeighedMotion:
    """The dynamic window approach itself: the arc of the least weighted cost."""

    name = "dwa"

    def see(self, percept: Percept) -> None:
        """Nothing is remembered."""

    def reset(self) -> None:
        """Nothing to forget."""

    def arcs(
        self,
        config: DwaConfig,
        percept: Percept,
        target: tuple[float, float],
        around: Surroundings,
        max_speed: float,
        slip: Slip = NO_SLIP,
    ) -> Rollout:
        v, w = candidates(config, percept.twist)
        return evaluate(config, v, w, percept.pose, target, around, max_speed, slip)


def make_motion(name: str) -> Motion:
    """By its name. Raises ValueError, naming those there are, for another one."""
    if name not in MOTIONS:
        raise ValueError(f"there is no motion control {name!r}; choose one of {', '.join(MOTIONS)}")
    if name == "dwa_rl":
        from planner.dwa_rl import LearnedMotion  # torch is for those who learn

        return LearnedMotion()
    return WeighedMotion()
