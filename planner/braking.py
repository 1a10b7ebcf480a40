"""How far the Husky rolls on once it is told to stop, by its data sheet."""

from __future__ import annotations

import numpy as np

from scenes.pose import Pose, Twist
from scenes.robot import HUSKY


class LevelBraking:
    """The drive slows down at its greatest acceleration, on level ground and without delay."""

    def ways(self, pose: Pose, twist: Twist) -> np.ndarray:
        """(1,) metres along its heading that a robot told to stop here rolls on."""
        return np.array([max(twist.v, 0.0) ** 2 / (2.0 * HUSKY.max_acceleration)])
