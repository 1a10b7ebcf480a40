"""The planning methods, found by name: adding one is a file here and a line in `METHODS`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from planner.driver import Driver
from planner.frames import Decision, Percept
from planner.methods.covernav import CoverNav, CoverNavConfig
from planner.methods.dwa import PlainDwa
from planner.methods.least_cost import LeastCost
from planner.methods.route import FollowRoute, balanced, most_hidden, shortest
from planner.methods.wary import Wary
from planner.motion import MOTIONS, make_motion
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


@runtime_checkable
class Driving(Protocol):
    """A method that leaves it to a driver to get to its waypoints; the driver's motion can be exchanged."""

    driver: Driver


class Weights(Protocol):
    """Of a learned policy: the file's stem, and the SHA-256 of its bytes."""

    @property
    def name(self) -> str: ...
    @property
    def sha256(self) -> str: ...


POLICIES = Path(__file__).parents[1] / "policies"


@runtime_checkable
class Learned(Protocol):
    """A method with weights, named in a drive's summary."""

    policy: Weights


def policies_of(method: Method) -> list[dict[str, str]]:
    """Name and SHA-256 of the weights that a method drives with: its own first, then its motion control's."""
    motion = method.driver.motion if isinstance(method, Driving) else None
    learned = [each.policy for each in (method, motion) if isinstance(each, Learned)]
    return [{"name": weights.name, "sha256": weights.sha256} for weights in learned]


@dataclass(frozen=True)
class MethodEntry:
    """How a method is made from a seed, and what it is in one sentence."""

    make: Callable[[int], Method]
    description: str


def _covernav_paper(weights: Path | None = None, **changed: Any) -> Method:
    from planner.methods.covernav_paper import POLICY, CoverNavPaper, PaperConfig  # torch is for learners

    return CoverNavPaper(weights or POLICY, PaperConfig(**changed))


def _terp(weights: Path | None = None) -> Method:
    from planner.methods.terp import Terp  # torch is for those who learn

    return Terp() if weights is None else Terp(weights)


def _ga_nav(weights: Path | None = None) -> Method:
    from planner.methods.ga_nav import GaNavPlanner  # torch is for those who learn

    return GaNavPlanner() if weights is None else GaNavPlanner(weights)


def _covernav(config: CoverNavConfig | None = None) -> Method:
    return CoverNav(config, POLICIES / "covernav.safetensors")


METHODS: Mapping[str, MethodEntry] = {
    "least_cost": MethodEntry(
        lambda seed: LeastCost(),
        "Follows the least-cost route over slope, obstacles and unknown ground of the robot's own map.",
    ),
    "covernav": MethodEntry(
        lambda seed: _covernav(),
        "Follows the least exposed of the routes over the robot's own map that are not too long.",
    ),
    "covernav_paper": MethodEntry(
        lambda seed: _covernav_paper(),
        "The paper's learner: a cost map from its network's attention, driven over by the dynamic window.",
    ),
    "terp": MethodEntry(
        lambda seed: _terp(),
        "TERP: a cost map from its network's attention over slopes, driven over by the dynamic window.",
    ),
    "ga_nav": MethodEntry(
        lambda seed: _ga_nav(),
        "GA-Nav: its network tells ground by its looks; follows the least-cost route over that and slopes.",
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
DEFAULT_METHOD = "covernav"

COMPARED = ("dwa", "ga_nav", "terp", "least_cost", "covernav_paper", "covernav", "route")
"""What is usually compared, of those that there are: the paper's methods, ours, and one that knows all."""

VARIANTS: Mapping[str, MethodEntry] = {
    "covernav[no_learning]": MethodEntry(
        lambda seed: CoverNav(),
        "covernav without its network: those who walk or drive about are thought to go straight on.",
    ),
    "covernav[no_foresight]": MethodEntry(
        lambda seed: CoverNav(CoverNavConfig(meeting=0.0)),
        "covernav whose routes take no heed of those who walk or drive about.",
    ),
    "covernav[no_cover]": MethodEntry(
        lambda seed: _covernav(CoverNavConfig(cover=False)),
        "covernav without what the camera tells of cover.",
    ),
    "covernav[no_exposure]": MethodEntry(
        lambda seed: _covernav(CoverNavConfig(weights=())),
        "covernav without exposure among its costs: the least-cost route.",
    ),
    "covernav_paper[no_attention]": MethodEntry(
        lambda seed: _covernav_paper(attention=False),
        "covernav_paper with a cost map made by hand, of steepness alone.",
    ),
    "covernav_paper[no_cbam]": MethodEntry(
        lambda seed: _covernav_paper(cbam=False),
        "covernav_paper with its network's features as they are before the attention module.",
    ),
    "covernav_paper[literal_reward]": MethodEntry(
        lambda seed: _covernav_paper(POLICIES / "covernav_paper_literal.safetensors"),
        "covernav_paper trained under the reward as published instead of the corrected one.",
    ),
    "covernav_paper[literal_cost]": MethodEntry(
        lambda seed: _covernav_paper(literal=True),
        "covernav_paper with the cost map as published, attention times height.",
    ),
}
"""Ablations, made and described as methods are, under names such as `covernav[no_exposure]`: known to
`make_method`, and with it to the command line, but not offered in the studio."""


LEARNED: Mapping[str, Callable[[Path], Method]] = {
    "covernav_paper": _covernav_paper,
    "terp": _terp,
    "ga_nav": _ga_nav,
    "covernav": lambda weights: CoverNav(weights=weights),
}
"""The methods that take other weights than their own."""


def make_method(name: str, seed: int = 0, weights: Path | None = None) -> Method:
    """A fresh method by its name, with weights of a training instead of its own where given. `NAME@WEIGHTS`
    gives them in the name: shipped ones by their name, others by their file. `NAME+MOTION` has the arcs of
    the dynamic window chosen by another motion control than its own.

    Raises ValueError, naming those there are, for another name, and for weights that it does not take."""
    name, motion = with_motion(name)
    method = _planning(name, seed, weights)
    if motion != MOTIONS[0]:
        if not isinstance(method, Driving):
            raise ValueError(f"the method {name} has no motion control that could be exchanged")
        method.driver.motion = make_motion(motion)
    return method


def with_motion(name: str) -> tuple[str, str]:
    """The method of a name, and its motion control. Raises ValueError for a motion that there is not."""
    method, plus, motion = name.rpartition("+")
    in_a_path = "@" in method and motion not in MOTIONS
    if not plus or in_a_path:
        return name, MOTIONS[0]
    if motion not in MOTIONS:
        raise ValueError(f"there is no motion control {motion!r}; choose one of {', '.join(MOTIONS)}")
    return method, motion


def _planning(name: str, seed: int, weights: Path | None) -> Method:
    name, _, named = name.partition("@")
    if named and weights is None:
        shipped = {path.stem: path for path in POLICIES.glob("*.safetensors")}
        weights = shipped.get(named, Path(named))
    entry = METHODS.get(name) or VARIANTS.get(name)
    if entry is None:
        raise ValueError(f"there is no method {name!r}; choose one of {', '.join((*METHODS, *VARIANTS))}")
    if weights is not None:
        if name not in LEARNED:
            raise ValueError(f"the method {name} takes no weights; {' and '.join(LEARNED)} do")
        return LEARNED[name](weights)
    return entry.make(seed)
