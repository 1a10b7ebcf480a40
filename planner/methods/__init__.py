"""The planning methods, found by name: adding one is a file here and a line in `METHODS`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from planner.frames import Decision, Percept
from planner.methods.dwa import PlainDwa
from planner.methods.least_cost import LeastCost


class Method(Protocol):
    """Decides from what the robot knows; keeps its own memory between ticks."""

    name: str

    def decide(self, percept: Percept) -> Decision:
        """The command for the coming decision period, with what led to it."""
        ...

    def reset(self) -> None:
        """Forget what was learnt on the way, as for a new goal."""
        ...


@dataclass(frozen=True)
class MethodEntry:
    """How a method is made from a seed, and what it is in one sentence."""

    make: Callable[[int], Method]
    description: str


METHODS: Mapping[str, MethodEntry] = {
    "least_cost": MethodEntry(
        lambda seed: LeastCost(),
        "Follows the least-cost route over slope, obstacles and unknown ground of the robot's own map.",
    ),
    "dwa": MethodEntry(
        lambda seed: PlainDwa(),
        "Plain dynamic window approach, straight for the goal: the paper's baseline.",
    ),
}
DEFAULT_METHOD = "least_cost"


def make_method(name: str, seed: int = 0) -> Method:
    """A fresh method by its name. Raises ValueError, naming those there are, for another name."""
    if name not in METHODS:
        raise ValueError(f"there is no method {name!r}; choose one of {', '.join(METHODS)}")
    return METHODS[name].make(seed)
