"""The bench of whole missions: how long a tick takes, and how much faster than real time a drive runs."""

from __future__ import annotations

import time

from app.bench.measure import Result, faster, percentile
from planner.frames import Frame, Perception
from planner.methods import DEFAULT_METHOD
from planner.mission import TICK_S, Mission
from scenes.families import generate
from scenes.scenario import Family

SEEDS = (1, 2, 3)
WARM_UP_TICKS = 12
REPEATED_TICKS = 60


def tick() -> Result:
    """Sense, perceive and plan in sensor mode: the 95th percentile over the ticks of three forest drives."""
    drives = [_drive(seed)[0] for seed in SEEDS]
    spent = [frame.planner_ms for frames in drives for frame in frames[WARM_UP_TICKS:]]
    period_ms = 1e3 * TICK_S
    return faster(
        "tick",
        percentile(spent, 95.0),
        period_ms,
        "the 100 ms control period",
        f"p95 of {len(spent)} ticks, median {percentile(spent, 50.0):.1f} ms; {_repeatability(drives[0])}",
    )


def mission_speed() -> Result:
    """Simulated seconds a second, physics at 240 Hz included, over three headless forest drives; compiled
    kernels are loaded before."""
    _drive(SEEDS[0], WARM_UP_TICKS)
    simulated = wall = 0.0
    ends = []
    drives = []
    for seed in SEEDS:
        frames, seconds = _drive(seed)
        simulated += len(frames) * TICK_S
        wall += seconds
        ends.append(frames[-1].status.value)
        drives.append(frames)
    factor = simulated / wall
    return Result(
        "mission_speed",
        round(factor, 2),
        1.0,
        "real time",
        round(factor, 2),
        "simulated s / s",
        f"drives of {simulated:.0f} s ended {', '.join(ends)}; {_repeatability(drives[0])}",
    )


def _drive(seed: int, ticks: int | None = None) -> tuple[list[Frame], float]:
    """The frames of a forest drive and the wall seconds it took, building the world not counted."""
    scenario = generate(Family.FOREST, seed)
    with Mission(scenario, DEFAULT_METHOD, seed, Perception.LIDAR) as mission:
        frames = []
        begun = time.perf_counter()
        while not mission.status.final and (ticks is None or len(frames) < ticks):
            frames.append(mission.tick())
        return frames, time.perf_counter() - begun


def _repeatability(frames: list[Frame]) -> str:
    """Whether the first drive's beginning comes out the same again."""
    again, _ = _drive(SEEDS[0], REPEATED_TICKS)
    same = all(a.pose == b.pose and a.twist == b.twist for a, b in zip(again, frames, strict=False))
    outcome = "the same poses to the last bit" if same else "OTHER poses"
    return f"the first {len(again)} ticks driven again gave {outcome}"
