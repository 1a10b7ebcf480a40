"""How the robot slips aside, learnt while it drives from nothing but its own poses.

A skid-steered robot turns about the axle that bears more, so its middle slips aside, and slides down a slope
that it drives across.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.dwa import NO_SLIP, Slip
from scenes.pose import Pose, wrap_angle

ELSEWHERE = 0.5
"""Metres from one pose to the next from which the robot was put somewhere else."""


@dataclass
class SlipEstimate:
    """Normalised least mean squares (Widrow and Hoff 1960) on both ways to slip at once.

    rate : how fast it learns; most : metres a radian or a metre that are believed
    least_motion : radians or metres from pose to pose below which there is nothing to learn from
    """

    rate: float = 0.3
    most: float = 0.4
    least_motion: float = 0.01
    slip: Slip = NO_SLIP
    _before: Pose | None = None

    def see(self, pose: Pose) -> None:
        """Learn from the way since the last pose."""
        before, self._before = self._before, pose
        if before is None:
            return
        turned = float(wrap_angle(pose.yaw - before.yaw))
        dx, dy = pose.x - before.x, pose.y - before.y
        if math.hypot(dx, dy) > ELSEWHERE:
            return
        middle = before.yaw + 0.5 * turned
        driven = abs(math.cos(middle) * dx + math.sin(middle) * dy)
        aside = math.cos(middle) * dy - math.sin(middle) * dx
        motion = turned * turned + driven * driven
        if motion < self.least_motion**2:
            return
        slip, most = self.slip, self.most
        step = self.rate * (aside - slip.turning * turned - slip.driving * driven) / motion
        turning, driving = slip.turning + step * turned, slip.driving + step * driven
        self.slip = Slip(float(np.clip(turning, -most, most)), float(np.clip(driving, -most, most)))
