"""What a training depends on, and how its folder holds that."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from planner.ddpg import DdpgConfig
from planner.learning_errors import TrainingRefusal
from planner.networks import PAPER, Architecture
from scenes.scenario import Family

ENVIRONMENT = "CoverNav-v0"
DEMONSTRATOR = "least_cost"
COUNTS = ("episodes", "steps", "seed", "random_episodes", "demonstrations")
ALL_TERRAINS = tuple(family.value for family in Family)


@dataclass(frozen=True)
class TrainingSettings:
    """What a training depends on, as published where the paper says.

    episodes, steps : of the training, and of each episode at most
    environment, options : for `gymnasium.make`
    resets : options of the reset, taken in turn from episode to episode
    random_episodes : driven at random before the policy drives
    demonstrations : per cent of the episodes that `DEMONSTRATOR` drives in the policy's place, evenly among
        them; they are learnt from like the others, and count neither in curves nor for a promotion
    curriculum : the tasks come from `planner.curriculum.Curriculum`, in place of `resets` and `steps`
    """

    episodes: int = 100
    steps: int = 100
    seed: int = 0
    environment: str = ENVIRONMENT
    options: Mapping[str, Any] = field(default_factory=dict)
    resets: tuple[Mapping[str, Any], ...] = tuple({"terrain": terrain} for terrain in ALL_TERRAINS)
    random_episodes: int = 2
    demonstrations: int = 0
    curriculum: bool = False
    architecture: Architecture = PAPER
    ddpg: DdpgConfig = field(default_factory=DdpgConfig)

    def __post_init__(self) -> None:
        """Raises ValueError for demonstrations that leave nothing to the policy."""
        if not 0 <= self.demonstrations < 100:
            share = self.demonstrations
            raise ValueError(f"demonstrations are 0 to 99 per cent of the episodes, not {share}")

    def demonstrated(self, number: int) -> bool:
        """Whether an episode is one of the demonstrations."""
        return (number + 1) * self.demonstrations // 100 > number * self.demonstrations // 100

    def document(self) -> dict[str, Any]:
        """As JSON holds it. Raises TrainingRefusal for options that JSON does not hold."""
        plain = replace(self, options={}, resets=())
        given = {"options": dict(self.options), "resets": [dict(reset) for reset in self.resets]}
        try:
            return asdict(plain) | json.loads(json.dumps(given, allow_nan=False))
        except (TypeError, ValueError) as error:
            words = f"options must be what JSON holds, such as a reward's name ({error})"
            raise TrainingRefusal(words) from None

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> TrainingSettings:
        """Raises TrainingRefusal where it is of another version."""
        try:
            ddpg = DdpgConfig(**{**document["ddpg"], "betas": tuple(document["ddpg"]["betas"])})
            architecture = Architecture(**document["architecture"])
            document = {name: given for name, given in document.items() if name != "demonstration_share"}
            changed = {"ddpg": ddpg, "architecture": architecture, "resets": tuple(document["resets"])}
            found = cls(**{**document, **changed})
            counts = {name: getattr(found, name) for name in COUNTS}
            for name, count in counts.items():
                if type(count) is not int or count < 0:
                    raise ValueError(f"{name} is {count!r}, not a whole number")
            return found
        except (KeyError, TypeError, ValueError) as error:
            raise TrainingRefusal(f"the settings are of another version ({error})") from None
