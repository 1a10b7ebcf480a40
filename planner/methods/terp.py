"""TERP (Weerakoon et al. 2022): its network's attention over the elevation makes a cost map, the cost map a
waypoint, and the dynamic window drives there. It knows nothing of cover or observers.

What its published code does differently, and why this one does not:

- Dropout stays on when driving, so that the same ground is planned over differently from call to call. The
  network here has none.
- The cost is attention times height: a flat plateau is dear, and a pit is cheap. Here it is attention times
  steepness; `PaperConfig(literal=True)` has theirs (`planner.attention_cost`).
- Path lengths mix x and y. Here they are summed over the true poses, in the plane (`planner.leg`).
- A drive has failed at 30° of tilt or with a return nearer than 0.6 m, which a gap that the Husky passes
  gives. Here a drive fails as every method's: on contact, on rolling over, or out of time.
"""

from __future__ import annotations

from pathlib import Path

from planner.methods.covernav_paper import CoverNavPaper, PaperConfig

POLICY = Path(__file__).parents[1] / "policies" / "terp.safetensors"


class Terp(CoverNavPaper):
    """Drives by weights from `covernav train --learner terp`. Raises PolicyError where they cannot be used.

    The network reads 40 × 40 cells of elevation about the robot, unknown ones filled from the nearest known,
    and 25 numbers: goal distance and bearing, pitch, roll, heading change, and 20 slopes ahead.
    """

    name = "terp"

    def __init__(self, weights: Path = POLICY, config: PaperConfig | None = None):
        super().__init__(weights, config)
