"""GA-Nav as a planner (Guan et al. 2022): what its network takes the ground for costs besides the elevation;
the least-cost way is driven by the dynamic window. It knows nothing of observers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from planner.cost_map import CostMap
from planner.frames import CameraView, CostPatch, Decision, GridMap, Percept, Perception, Segmentation
from planner.ga_nav.ground import GroundGroups, GroupCosts, cut_out, true_groups
from planner.ga_nav.network import load_network, segment
from planner.methods.least_cost import LeastCost, LeastCostConfig
from planner.route import Route, least_cost_route
from scenes.rays import RayScene
from scenes.scenario import Scenario
from scenes.terrain import Heightmap

POLICY = Path(__file__).parents[1] / "policies" / "ga_nav.safetensors"


@dataclass(frozen=True)
class GaNavConfig:
    """groups : what each costs; planner : of the map, the route and the drive, as of `least_cost`"""

    groups: GroupCosts = field(default_factory=GroupCosts)
    planner: LeastCostConfig = field(default_factory=LeastCostConfig)


class GaNavPlanner(LeastCost):
    """Looks at each image once, when it is taken. In the oracle's perception, which has no images, the ground
    has its true groups: by its surface and what stands there, with no word of the network.

    policy : which weights. Raises PolicyError where they cannot be used.
    """

    name = "ga_nav"

    def __init__(self, weights: Path = POLICY, config: GaNavConfig | None = None):
        self.ga_nav = config or GaNavConfig()
        super().__init__(self.ga_nav.planner)
        self._weights = weights
        self._truth: tuple[Heightmap, np.ndarray] | None = None
        self._forget()
        self._load()

    def _load(self) -> None:
        torch.set_num_threads(1)
        self._network, self.policy = load_network(self._weights)

    def brief(self, scenario: Scenario, rays: RayScene) -> None:
        """Take over the truth, which is looked at where the perception is the oracle's alone."""
        self._truth = rays.heightmap, true_groups(scenario, rays.heightmap)

    def reset(self) -> None:
        super().reset()
        self._forget()

    def _forget(self) -> None:
        self._ground = GroundGroups()
        self._looked: CameraView | None = None
        self._seen: Segmentation | None = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_network": None, "_looked": None, "_truth": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._load()

    def decide(self, percept: Percept) -> Decision:
        self._seen = self._look(percept)
        return replace(super().decide(percept), segmentation=self._seen)

    def _look(self, percept: Percept) -> Segmentation:
        """What the ground is taken for at this tick."""
        grid, seen = percept.grid, self._seen
        same = seen is not None and (seen.x_min, seen.y_min) == (grid.x_min, grid.y_min)
        if percept.perception is Perception.ORACLE and self._truth is not None:
            if seen is not None and same and seen.rgb is None:
                return seen
            heightmap, groups = self._truth
            return _segmentation(grid, cut_out(groups, heightmap, grid))
        view = percept.view
        if view is not None and view is not self._looked:
            self._looked = view
            groups, sure = segment(self._network, view.image.rgb)
            self._ground.add(view, groups, sure, grid)
            return _segmentation(grid, self._ground.labels, view.image.rgb[::2, ::2], groups)
        if seen is not None and same:
            return seen
        self._ground.move_to(grid)
        image = (None, None) if seen is None else (seen.rgb, seen.groups)
        return _segmentation(grid, self._ground.labels, *image)

    def _find_route(
        self,
        percept: Percept,
        cost_map: CostMap,
        cost: np.ndarray,
        start: tuple[int, int],
        goal: tuple[float, float],
    ) -> tuple[Route, np.ndarray, CostPatch]:
        points = self._points(percept)
        dearer = cost + points / self.config.points_per_metre
        patch = cost_map.patch()
        drawn = np.where(np.isinf(patch.cost), patch.cost, np.minimum(patch.cost + points, 100.0))
        shown = CostPatch(patch.x_min, patch.y_min, patch.resolution, drawn.astype(np.float32))
        return least_cost_route(dearer, cost_map.resolution, start, goal), dearer, shown

    def _points(self, percept: Percept) -> np.ndarray:
        """(rows, cols) points of 0..100 that the groups cost over the percept's grid."""
        costs = self.ga_nav.groups
        if percept.perception is Perception.ORACLE and self._seen is not None:
            table = np.full(256, costs.rough)
            table[: len(costs.table)] = costs.table
            return table[self._seen.ground]
        return self._ground.cost(costs)


def _segmentation(
    grid: GridMap, ground: np.ndarray, rgb: np.ndarray | None = None, groups: np.ndarray | None = None
) -> Segmentation:
    return Segmentation(grid.x_min, grid.y_min, grid.resolution, ground, rgb, groups)
