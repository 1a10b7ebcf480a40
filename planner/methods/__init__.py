"""The planning methods, found by name: adding one is a file here and a line in `METHODS`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from planner.frames import Decision, Percept
from planner.methods.covernav import CoverNav
from planner.methods.dwa import PlainDwa
from planner.methods.least_cost import LeastCost
from planner.methods.route import FollowRoute, balanced, most_hidden, shortest
from planner.methods.wary import Wary
from scenes.rays import RayScene
from scenes.scenario import Scenario


class Method(Protocol):
    """Decides from what the robot knows; keeps its own memory between ticks."""

    name: str

    def decide(self, percept: Percept) -> Decision:
        """The command for the coming decision period, with what led to it."""
        ...

    def reset(self) -> None:
        """Forget what was learnt on the way, as for a new goal."""
        ...


@runtime_checkable
class Briefed(Protocol):
    """A method that plans on the truth: a mission briefs it before it decides and after every edit."""

    def brief(self, scenario: Scenario, rays: RayScene) -> None:
        """Take over the true scenario; `rays` holds its ground and cover."""
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
    "covernav": MethodEntry(
        lambda seed: CoverNav(),
        "Follows the least exposed of the routes over the robot's own map that are not too long.",
    ),
    "dwa": MethodEntry(
        lambda seed: PlainDwa(),
        "Plain dynamic window approach, straight for the goal: the paper's baseline.",
    ),
    "route": MethodEntry(
        lambda seed: FollowRoute("route", most_hidden),
        "Follows the most hidden route of at most twice the shortest's length, with everything known.",
    ),
    "route_balanced": MethodEntry(
        lambda seed: FollowRoute("route_balanced", balanced),
        "Follows the balanced route, a second in view worth six hidden ones, with everything known.",
    ),
    "route_shortest": MethodEntry(
        lambda seed: FollowRoute("route_shortest", shortest),
        "Follows the shortest drivable route with everything known.",
    ),
    "route_known": MethodEntry(
        lambda seed: Wary("route_known"),
        "Follows the most hidden route from the observers it knows; takes another when it spots one.",
    ),
    "route_wary": MethodEntry(
        lambda seed: Wary("route_wary", seed, believes=True),
        "As route_known, and keeps out of view of where observers not yet seen may stand.",
    ),
}
DEFAULT_METHOD = "least_cost"


def make_method(name: str, seed: int = 0) -> Method:
    """A fresh method by its name. Raises ValueError, naming those there are, for another name."""
    if name not in METHODS:
        raise ValueError(f"there is no method {name!r}; choose one of {', '.join(METHODS)}")
    return METHODS[name].make(seed)
