"""The bench of the dynamic window."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from app.bench.measure import Result, faster, interleaved
from app.bench.peers import ReferenceDwa
from planner.dwa import DwaConfig, Footprint, Surroundings, Weights, evaluate
from scenes.pose import Pose

OBSTACLES = 15
SITUATIONS = 12
REPEATS = 9


def dwa_cycle() -> Result:
    """One cycle at PythonRobotics' default sampling: about 400 arcs of 31 poses against 15 obstacles."""
    peer = ReferenceDwa()
    situations = [_situation(np.random.default_rng(seed)) for seed in range(SITUATIONS)]
    state, goal, obstacles = situations[0]
    ours_ms, peer_ms = interleaved(
        lambda: _choose(peer, state, goal, obstacles),
        lambda: peer.choose(state, goal, obstacles),
        REPEATS,
        ours_per_turn=20,
    )
    agreed, blocked, worst = 0, 0, 0.0
    for situation in situations:
        ours, theirs = _choose(peer, *situation), peer.choose(*situation)
        agreed += ours[:2] == theirs[:2]
        blocked += math.isinf(ours[2]) and math.isinf(theirs[2])
        if math.isfinite(ours[2]) and math.isfinite(theirs[2]):
            worst = max(worst, abs(ours[2] - theirs[2]))
    speeds, yaw_rates = peer.velocities(state[3], state[4])
    return faster(
        "dwa_cycle",
        ours_ms,
        peer_ms,
        "dynamic window in plain Python and NumPy after PythonRobotics' description and defaults",
        f"same (v, w) chosen among {len(speeds) * len(yaw_rates)} arcs in {agreed} of {SITUATIONS} "
        f"situations ({blocked} of them without a free arc); largest difference of its cost {worst:.1e}",
    )


def _situation(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A robot's state (5,) in motion, a goal ahead of it (2,), and obstacles (15, 2) it can drive between."""
    state = np.array([0.0, 0.0, rng.uniform(-0.4, 0.4), rng.uniform(0.4, 0.8), rng.uniform(-0.2, 0.2)])
    goal = np.array([10.0, rng.uniform(-4.0, 4.0)])
    angle, reach = rng.uniform(-math.pi, math.pi, OBSTACLES), rng.uniform(2.5, 9.0, OBSTACLES)
    away = np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])
    return state, goal, away[np.argsort(np.abs(angle))]


def _choose(
    peer: ReferenceDwa, state: np.ndarray, goal: np.ndarray, obstacles: np.ndarray
) -> tuple[float, float, float]:
    """The peer's `choose` by `planner.dwa`, with the peer's window, sampling, robot and cost."""
    speeds, yaw_rates = peer.velocities(state[3], state[4])
    v, w = np.repeat(speeds, len(yaw_rates)), np.tile(yaw_rates, len(speeds))
    pose = Pose(float(state[0]), float(state[1]), 0.0, yaw=float(state[2]))
    arcs = evaluate(_config(peer), v, w, pose, (goal[0], goal[1]), Surroundings(obstacles)).arcs
    if arcs.chosen < 0:
        return 0.0, 0.0, math.inf
    return float(v[arcs.chosen]), float(w[arcs.chosen]), float(arcs.total[arcs.chosen])


@cache
def _config(peer: ReferenceDwa) -> DwaConfig:
    """Euler steps, one circle, every arc free over its whole length, and the peer's three terms alone."""
    return DwaConfig(
        max_speed=peer.max_speed,
        horizon=peer.horizon,
        dt=peer.dt,
        heading_share=1.0,
        braking=0.0,
        yaw_braking=0.0,
        margin=0.0,
        speed_margin=0.0,
        escape_speed=-1.0,
        point_radius=0.0,
        clearance_reach=math.inf,
        footprint=Footprint(0.0, 0.0, peer.radius),
        weights=Weights(
            heading=peer.heading_gain,
            clearance=peer.obstacle_gain,
            velocity=peer.speed_gain,
            goal=0.0,
            unknown=0.0,
            tilt=0.0,
        ),
    )
