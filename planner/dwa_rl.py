"""DWA-RL's motion control (Patel et al. 2021): a learned policy chooses among the window's velocities.

Whatever it has learnt, it cannot choose what the window rejects: every velocity is rolled out over the map
and the moving obstacles' tracks first, and the rows of those that collide, cannot stop in time, tilt or leave
the ground are masked. So are those faster than the robot may go so near to its goal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from planner.dwa import NO_SLIP, DwaConfig, Rollout, Slip, Surroundings, evaluate
from planner.dwa_rl_window import WINDOW, MovingHistory, WindowView, velocities, view_window
from planner.frames import Percept, Rejection
from scenes.pose import Pose, Twist

POLICY = Path(__file__).parent / "policies" / "dwa_rl.safetensors"

Choice = Callable[[np.ndarray, np.ndarray], int]
"""From a tensor (rows, sets, 4) and which rows are admissible (rows,) to a row."""


@dataclass(frozen=True)
class Window:
    """What there is to choose from: arcs as rolled out, the same as rows, and which rows (rows,) may be
    chosen."""

    rollout: Rollout
    view: WindowView
    admissible: np.ndarray

    def chosen(self, row: int) -> Rollout:
        """The arcs with one row chosen; -1 chooses none."""
        index = int(self.view.order[row]) if row >= 0 else -1
        return replace(self.rollout, arcs=replace(self.rollout.arcs, chosen=index))


def open_window(
    config: DwaConfig,
    pose: Pose,
    twist: Twist,
    target: tuple[float, float],
    around: Surroundings,
    history: MovingHistory,
    max_speed: float,
    slip: Slip = NO_SLIP,
) -> Window:
    """Roll out the window's velocities from `pose` and see them as rows; `target` in the world."""
    dwa = replace(config, horizon=min(config.horizon, WINDOW.horizon))
    v, w = velocities(dwa, twist)
    rollout = evaluate(dwa, v, w, pose, target, around, max_speed, slip)
    arcs = rollout.arcs
    view = view_window(v, w, arcs.poses, target, around.points, history.discs(), dwa, max_speed)
    # A robot that is too fast already slows down as fast as it can.
    allowed = (arcs.rejection == Rejection.NONE) & (v <= max(max_speed, float(v.min())) + 1e-9)
    if not allowed.any():
        allowed = arcs.rejection == Rejection.NONE
    return Window(rollout, view, allowed[view.order])


class LearnedMotion:
    """Drives by weights from `covernav train --learner dwa_rl`. Raises PolicyError where they cannot be used.

    policy : which weights
    """

    name = "dwa_rl"

    def __init__(self, weights: Path = POLICY):
        self._weights = weights
        self._history = MovingHistory()
        self._load()

    def _load(self) -> None:
        import torch

        from planner.dwa_rl_network import load_window_policy

        torch.set_num_threads(1)
        self._network, self.policy = load_window_policy(self._weights)

    def reset(self) -> None:
        self._history = MovingHistory()

    def see(self, percept: Percept) -> None:
        self._history.see(percept.pose, percept.moving)

    def arcs(
        self,
        config: DwaConfig,
        percept: Percept,
        target: tuple[float, float],
        around: Surroundings,
        max_speed: float,
        slip: Slip = NO_SLIP,
    ) -> Rollout:
        seen = open_window(
            config, percept.pose, percept.twist, target, around, self._history, max_speed, slip
        )
        if not seen.admissible.any():
            return seen.chosen(-1)
        return seen.chosen(self._choose(seen.view.tensor, seen.admissible))

    def _choose(self, tensor: np.ndarray, admissible: np.ndarray) -> int:
        import torch

        with torch.inference_mode():
            logits, _ = self._network(torch.from_numpy(tensor[None]), torch.from_numpy(admissible[None]))
        return int(logits[0].argmax())

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_network", "policy")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._load()
