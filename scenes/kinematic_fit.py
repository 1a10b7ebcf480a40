"""Where the numbers of `scenes.kinematics.HUSKY_RESPONSE` come from, and how well they do.

`python -m scenes.kinematic_fit` drives the physics at random on the four terrains, fits the motion model's
response to half of the drives, and prints it with its errors on the other half.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from scenes.families import generate
from scenes.kinematic_kernel import REFERENCE_V, REFERENCE_W, SPEED, STATE_SIZE, YAW, YAW_RATE, X, Y
from scenes.kinematics import HUSKY_RESPONSE, STEP_S, Response, advance
from scenes.physics import World
from scenes.pose import Twist, wrap_angle
from scenes.robot import HUSKY
from scenes.scenario import Family
from scenes.terrain import Heightmap
from scenes.traversability import blocked_cells

PERIOD_S, COMMANDS, PERIODS_A_COMMAND = 0.25, 10, 2
MARGIN = 6.0  # metres from the map's edge, farther than a drive goes
FIRST_SEED = 2_000_000
GROUNDS, DRIVES = 4, 10  # of each terrain; of each ground
YAW_LEVER = 0.5
"""Metres that a radian of yaw is worth beside an error of place: half the robot's length."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive from standing, sampled every `PERIOD_S`.

    commands : (n, 2) v and w held for each period
    states : (n + 1, 5) x, y, yaw, forward speed, yaw rate
    """

    terrain: Family
    ground: Heightmap
    commands: np.ndarray
    states: np.ndarray

    @cached_property
    def references(self) -> np.ndarray:
        """(n + 1, 2) what the drive follows the commands with, which keeps to its accelerations."""
        reach = PERIOD_S * np.array([HUSKY.max_acceleration, HUSKY.max_yaw_acceleration])
        followed = [np.zeros(2)]
        for command in self.commands:
            followed.append(followed[-1] + np.clip(command - followed[-1], -reach, reach))
        return np.array(followed)


def record(terrain: Family, seed: int, drives: int) -> Iterator[Drive]:
    """Random drives in physics over one generated ground, without what stands on it."""
    rng = np.random.default_rng(seed)
    ground = generate(terrain, seed, observers=0).terrain.heightmap()
    free = ~blocked_cells(ground, ())
    border = math.ceil(MARGIN / ground.resolution)
    free[:border] = free[-border:] = free[:, :border] = free[:, -border:] = False
    rows, cols = np.nonzero(free)
    with World(ground) as world:
        for pick in rng.integers(len(rows), size=drives):
            x = ground.x_min + ground.resolution * float(cols[pick])
            y = ground.y_min + ground.resolution * float(rows[pick])
            world.place_robot(x, y, float(rng.uniform(-math.pi, math.pi)))
            yield _drive(terrain, world, rng)


def _drive(terrain: Family, world: World, rng: np.random.Generator) -> Drive:
    chosen = rng.uniform((0.0, -HUSKY.max_yaw_rate), (HUSKY.max_speed, HUSKY.max_yaw_rate), (COMMANDS, 2))
    chosen[rng.random(COMMANDS) < 0.3, 1] *= 0.2  # policies that know their way drive mostly straight on
    commands = np.repeat(chosen, PERIODS_A_COMMAND, axis=0)
    states = [_state(world)]
    for v, w in commands.tolist():
        world.step(Twist(v, w), PERIOD_S)
        states.append(_state(world))
    return Drive(terrain, world.heightmap, commands, np.array(states))


def _state(world: World) -> tuple[float, float, float, float, float]:
    pose, twist = world.pose, world.twist
    return pose.x, pose.y, pose.yaw, twist.v, twist.w


def residuals(drives: Sequence[Drive], response: Response, periods: int, stride: int = 2) -> np.ndarray:
    """(n, 3) model minus physics, `periods` after every `stride`-th sample at which both stand at one pose
    with one velocity: metres ahead, metres aside, radians."""
    numbers, steps = astuple(response), round(PERIOD_S / STEP_S)
    differences = []
    for drive in drives:
        for begin in range(0, len(drive.commands) - periods + 1, stride):
            state = np.zeros(STATE_SIZE)
            state[[X, Y, YAW, SPEED, YAW_RATE]] = drive.states[begin]
            state[REFERENCE_V : REFERENCE_W + 1] = drive.references[begin]
            for v, w in drive.commands[begin : begin + periods].tolist():
                advance(drive.ground, state, Twist(v, w), steps, numbers)
            x, y, yaw = drive.states[begin + periods, :3]
            dx, dy = state[X] - x, state[Y] - y
            cos, sin = math.cos(yaw), math.sin(yaw)
            turned = float(wrap_angle(state[YAW] - yaw))
            differences.append((cos * dx + sin * dy, cos * dy - sin * dx, turned))
    return np.array(differences)


def fit(drives: Sequence[Drive], begin: Response = HUSKY_RESPONSE) -> Response:
    """The response with the least error of pose 1 and 2.5 s ahead; far-off drives count less than squared."""

    def errors(numbers: np.ndarray) -> np.ndarray:
        response = Response(*numbers.tolist())
        ahead = [residuals(drives, response, periods, stride=4) for periods in (4, 10)]
        return (np.concatenate(ahead) * (1.0, 1.0, YAW_LEVER)).ravel()

    low = [0.01, 0.5, 0.5, *[-3.0] * (len(astuple(begin)) - 3)]
    high = [1.0, 1.5, 1.5, *[3.0] * (len(astuple(begin)) - 3)]
    found = least_squares(
        errors, astuple(begin), bounds=(low, high), loss="soft_l1", f_scale=0.1, diff_step=1e-3, x_scale=0.1
    )
    return Response(*found.x.tolist())


def agreement(drives: Sequence[Drive], response: Response) -> str:
    """Median and 90th percentile of the errors of place and heading, a line for each terrain."""
    lines = []
    for terrain in Family:
        chosen = [drive for drive in drives if drive.terrain is terrain]
        for periods in (4, 10):
            error = residuals(chosen, response, periods)
            place, turn = np.hypot(error[:, 0], error[:, 1]), np.degrees(np.abs(error[:, 2]))
            (near, far), (little, much) = np.percentile(place, (50, 90)), np.percentile(turn, (50, 90))
            lines.append(
                f"{terrain.value:8} after {periods * PERIOD_S:.1f} s: {near:.3f} m ({far:.3f} m),"
                f" {little:.1f}° ({much:.1f}°), {len(error)} stretches"
            )
    return "\n".join(lines)


def main() -> None:
    drives = [
        drive
        for terrain in Family
        for seed in range(FIRST_SEED, FIRST_SEED + GROUNDS)
        for drive in record(terrain, seed, DRIVES)
    ]
    response = fit(drives[::2])
    print(response)
    print("median and, in brackets, 90th percentile of the error on the drives held out:")
    print(agreement(drives[1::2], response))


if __name__ == "__main__":
    main()
