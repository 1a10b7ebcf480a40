"""What senses, judges and drives a world may rely on, whichever way the robot's motion comes about.

`scenes.physics.World` has rigid bodies and wheels that slide, `scenes.kinematics.KinematicWorld` a motion
model fitted to it, at a fiftieth of the time. World frame, metres, seconds, radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from scenes.pose import Pose, Twist
from scenes.scenario import CoverObject, MovingObstacle
from scenes.terrain import Heightmap


class RobotLostError(RuntimeError):
    """The robot has left the world: through the ground, over the border, or to a pose that is no number."""


@dataclass(frozen=True)
class Contact:
    """Something that touches the robot; `id` as in the scenario."""

    kind: Literal["cover", "obstacle"]
    id: int


class DrivenWorld(Protocol):
    """A Husky among cover and moving obstacles."""

    heightmap: Heightmap

    @property
    def time_s(self) -> float:
        """Simulated seconds."""
        ...

    @property
    def pose(self) -> Pose:
        """The true `pose_world_base`."""
        ...

    @property
    def twist(self) -> Twist:
        """True forward speed of the base and its rate of turn."""
        ...

    @property
    def up(self) -> float:
        """The z part of the body's up axis: 1 upright, negative on its back."""
        ...

    @property
    def wheel_angles(self) -> tuple[float, float, float, float]:
        """Radians turned: front left, front right, rear left, rear right."""
        ...

    def touching(self) -> tuple[Contact, ...]:
        """Cover and obstacles that the robot touched during the last `step`, each once."""
        ...

    def step(self, command: Twist, duration_s: float) -> None:
        """Drive at `command`, within the Husky's limits, for `duration_s`.

        Raises ValueError for a command or duration that makes no sense, RobotLostError where the robot has
        left the world."""
        ...

    def place_robot(self, x: float, y: float, yaw: float) -> None:
        """Stand the robot still at (x, y). Takes no time. Raises ValueError where it cannot stand."""
        ...

    def set_cover(self, cover: Sequence[CoverObject]) -> None: ...

    def set_obstacles(self, obstacles: Sequence[MovingObstacle]) -> None: ...

    def close(self) -> None: ...
