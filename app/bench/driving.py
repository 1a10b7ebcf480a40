"""The bench of whole missions: how long a tick takes, and how much faster than real time a drive runs."""

from __future__ import annotations

import time
from dataclasses import dataclass

from app.bench.measure import Result, faster, percentile
from planner.frames import Perception, Status
from planner.mission import TICK_S, Mission
from planner.warm_up import warm_up
from scenes.families import generate
from scenes.pose import Pose, Twist
from scenes.scenario import Family

SEEDS = (1, 2, 3)
WARM_UP_TICKS = 12
REPEATED_TICKS = 60


def tick() -> Result:
    """Sense, perceive and plan in sensor mode, without learning: the 95th percentile over the ticks of three
    forest drives."""
    return _tick("tick", "least_cost")


def covert_tick() -> Result:
    """As `tick`, with exposure to plan for, too."""
    return _tick("covert_tick", "covernav")


def mission_speed() -> Result:
    """Simulated seconds a second, physics at 240 Hz included, over three headless forest drives; compiled
    kernels are loaded before."""
    return _speed("mission_speed", "least_cost")


def covert_mission_speed() -> Result:
    """As `mission_speed`, with exposure to plan for, too."""
    return _speed("covert_mission_speed", "covernav")


def _tick(name: str, method: str) -> Result:
    warm_up(method)
    drives = [_drive(method, seed) for seed in SEEDS]
    spent = [ms for drive in drives for ms in drive.planner_ms[WARM_UP_TICKS:]]
    return faster(
        name,
        percentile(spent, 95.0),
        1e3 * TICK_S,
        "the 100 ms control period",
        f"p95 of {len(spent)} ticks of {method}, median {percentile(spent, 50.0):.1f} ms;"
        f" {_repeatability(drives[0])}",
    )


def _speed(name: str, method: str) -> Result:
    warm_up(method)
    drives = [_drive(method, seed) for seed in SEEDS]
    simulated = sum(len(drive.planner_ms) for drive in drives) * TICK_S
    factor = round(simulated / sum(drive.wall_s for drive in drives), 2)
    ends = [drive.status.value for drive in drives]
    return Result(
        name,
        factor,
        1.0,
        "real time",
        factor,
        "simulated s / s",
        f"drives of {method}, {simulated:.0f} s, ended {', '.join(ends)}; {_repeatability(drives[0])}",
    )


@dataclass(frozen=True)
class _Drive:
    """What is kept of a drive; not its frames, for no drive keeps them, and so many slow it down."""

    method: str
    motion: list[tuple[Pose, Twist]]
    planner_ms: list[float]
    status: Status
    wall_s: float


def _drive(method: str, seed: int, ticks: int | None = None) -> _Drive:
    """A forest drive, building the world not timed."""
    scenario = generate(Family.FOREST, seed)
    with Mission(scenario, method, seed, Perception.LIDAR) as mission:
        motion, planner_ms = [], []
        begun = time.perf_counter()
        while not mission.status.final and (ticks is None or len(motion) < ticks):
            frame = mission.tick()
            motion.append((frame.pose, frame.twist))
            planner_ms.append(frame.planner_ms)
        return _Drive(method, motion, planner_ms, mission.status, time.perf_counter() - begun)


def _repeatability(drive: _Drive) -> str:
    """Whether the drive of the first seed begins the same again."""
    again = _drive(drive.method, SEEDS[0], REPEATED_TICKS).motion
    same = again == drive.motion[: len(again)]
    outcome = "the same poses to the last bit" if same else "OTHER poses"
    return f"the first {len(again)} ticks driven again gave {outcome}"
