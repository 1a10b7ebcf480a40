"""From a goal 4 m away on easy ground to 50 m through a watched forest, a stage at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from planner.episode import Task
from scenes.scenario import Family


@dataclass(frozen=True)
class Stage:
    """What is drawn from on the way: every episode takes one of the terrains, and as many observers as the
    stage has, or fewer.

    goal_distance : metres, the farthest; half of the episodes go as far, the others anything from `nearest`
    patrols, unknown : share of the episodes in which observers walk, and in which the robot is not told of
        them
    steps : an episode may take
    """

    name: str
    terrains: tuple[Family, ...]
    goal_distance: float
    observers: int = 0
    patrols: float = 0.0
    unknown: float = 0.0
    obstacles: int = 0
    steps: int = 100
    nearest: float = 3.0

    def draw(self, rng: np.random.Generator) -> Task:
        """The task of one episode."""
        terrain = self.terrains[int(rng.integers(len(self.terrains)))]
        far, drawn = rng.random() < 0.5, float(rng.uniform(self.nearest, self.goal_distance))
        observers = int(rng.integers(self.observers + 1))
        patrols, unknown = rng.random() < self.patrols, rng.random() < self.unknown
        distance = self.goal_distance if far else round(drawn, 1)
        obstacles = int(rng.integers(self.obstacles + 1))
        return Task(terrain, distance, observers, patrols, not unknown, obstacles)


EASY = (Family.NORMAL,)
OPEN = (Family.NORMAL, Family.LOW)
HILLY = (Family.NORMAL, Family.LOW, Family.LOW_HIGH)
ALL = tuple(Family)

STAGES = (
    Stage("near", EASY, 4.0, steps=60),
    Stage("open ground", OPEN, 8.0, steps=80),
    Stage("hills", HILLY, 12.0, observers=1),
    Stage("forest", ALL, 12.0, observers=2),
    Stage("patrols", ALL, 12.0, observers=3, patrols=0.5, obstacles=1),
    Stage("unknown observers", ALL, 12.0, observers=3, patrols=0.5, unknown=0.5, obstacles=1),
    Stage("far", ALL, 25.0, observers=3, patrols=0.5, unknown=0.5, obstacles=1, steps=200),
    Stage("50 metres", ALL, 50.0, observers=3, patrols=0.5, unknown=0.5, obstacles=2, steps=400),
)
"""The paper's order: distance, terrain, and then those who watch. Its own runs at 50 m diverged."""


@dataclass(frozen=True)
class Promotion:
    """On to the next stage when `rate` of the last `episodes` on this one have succeeded."""

    rate: float = 0.8
    episodes: int = 20

    def __post_init__(self) -> None:
        """Raises ValueError for a rate or a number that makes no sense."""
        if not 0.0 < self.rate <= 1.0 or self.episodes < 1:
            raise ValueError(
                "promotion takes a rate above 0 and up to 1, of at least one episode,"
                f" got {self.rate} of {self.episodes}"
            )


@dataclass(frozen=True)
class Progress:
    """How far a training has come: the stage's index, its last outcomes, newest last, and how many episodes
    there have been."""

    stage: int = 0
    outcomes: tuple[bool, ...] = ()
    episodes: int = 0


class Curriculum:
    """The tasks of a training's episodes, one after the other.

    Episode k's task follows from the seed, k and the stage alone: given a seed and what came of the
    episodes, all is the same again, in whatever process.
    """

    def __init__(
        self,
        seed: int = 0,
        stages: Sequence[Stage] = STAGES,
        promotion: Promotion | None = None,
        progress: Progress | None = None,
    ):
        """Raises ValueError for no stages, or for progress beyond them."""
        self.seed, self.stages = seed, tuple(stages)
        self.promotion, self.progress = promotion or Promotion(), progress or Progress()
        if not 0 <= self.progress.stage < len(self.stages):
            raise ValueError(f"stage {self.progress.stage} is none of the {len(self.stages)}")

    @property
    def stage(self) -> Stage:
        return self.stages[self.progress.stage]

    @property
    def finished(self) -> bool:
        """Whether the last stage, too, has been passed."""
        return self.progress.stage == len(self.stages) - 1 and self._passed(self.progress.outcomes)

    def task(self) -> Task:
        """Of the episode that comes next."""
        rng = np.random.default_rng([self.seed, self.progress.episodes, self.progress.stage])
        return self.stage.draw(rng)

    def options(self) -> dict[str, Any]:
        """The same, as the options of `planner.environment.CoverNavEnv.reset`."""
        task = self.task()
        named = {field.name: getattr(task, field.name) for field in fields(task)}
        return named | {"max_steps": self.stage.steps}

    def record(self, success: bool) -> bool:
        """Count the episode that `task` gave; returns whether it brought the next stage."""
        outcomes = (*self.progress.outcomes, bool(success))[-self.promotion.episodes :]
        episodes = self.progress.episodes + 1
        if self._passed(outcomes) and self.progress.stage + 1 < len(self.stages):
            self.progress = Progress(self.progress.stage + 1, (), episodes)
            return True
        self.progress = replace(self.progress, outcomes=outcomes, episodes=episodes)
        return False

    def skip(self) -> None:
        """On to the next task of the stage: somebody else drove that of the last episode."""
        self.progress = replace(self.progress, episodes=self.progress.episodes + 1)

    def _passed(self, outcomes: Sequence[bool]) -> bool:
        needed = self.promotion
        return len(outcomes) >= needed.episodes and sum(outcomes) >= needed.rate * needed.episodes

    def state(self) -> dict[str, Any]:
        """Plain values to go on from with `restore`."""
        progress = self.progress
        return {
            "seed": self.seed,
            "stage": progress.stage,
            "outcomes": list(progress.outcomes),
            "episodes": progress.episodes,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state. Raises ValueError, naming what is wrong, for one that is none of ours."""
        try:
            seed, stage, episodes = (state[name] for name in ("seed", "stage", "episodes"))
            outcomes = tuple(state["outcomes"])
        except (KeyError, TypeError) as error:
            raise ValueError(f"the curriculum's state lacks {error}") from None
        whole = all(isinstance(number, int) and number >= 0 for number in (seed, stage, episodes))
        if not whole or not all(isinstance(outcome, bool) for outcome in outcomes):
            raise ValueError("the curriculum's state must hold whole numbers, and true or false for outcomes")
        if stage >= len(self.stages):
            raise ValueError(f"the curriculum's state is at stage {stage}; there are {len(self.stages)}")
        self.seed = seed
        self.progress = Progress(stage, outcomes[-self.promotion.episodes :], episodes)
