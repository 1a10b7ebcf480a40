"""An evaluation's file of drives that nobody drove, over a scene that there is."""

from functools import cache
from pathlib import Path

from app import results_store
from planner.scene_recipe import recipe
from scenes.families import generate
from scenes.scenario import Family, Scenario

METHODS = ("dwa", "covernav")
SIZE, GOAL = 24.0, 6.0


@cache
def scene() -> Scenario:
    return generate(Family.NORMAL, 3, size_m=SIZE, goal_distance=GOAL)


def trajectory(sideways_cm: int = 0, samples: int = 21):
    start, goal = scene().start, scene().goal
    share = [i / (samples - 1) for i in range(samples)]
    return {
        "period_s": 0.5,
        "end_s": 0.5 * (samples - 1),
        "x_cm": [round(100 * (start.x + s * (goal.x - start.x))) for s in share],
        "y_cm": [round(100 * (start.y + s * (goal.y - start.y))) + sideways_cm for s in share],
        "yaw_deg": [round(start.yaw)] * samples,
        "seen_pct": [50] * (samples // 2) + [0] * (samples - samples // 2),
    }


def drive(seed: int, method: str, status: str = "reached", terrain: str = "normal", **fields):
    ours = method == "covernav"
    return {
        "terrain": terrain, "method": method, "seed": seed, "perception": "lidar", "goal_distance": GOAL,
        "suite": "covert", "observers": "known", "placement": "uniform", "status": status,
        "success": status == "reached", "trajectory_length_m": 8.0 if ours else 6.5, "straight_line_m": 6.0,
        "execution_time_s": 10.0 + seed, "exposed_s": (2.0 if ours else 6.0) + 0.1 * seed,
        "cover_fraction": 0.5, "max_roll_deg": 2.0, "max_pitch_deg": 1.0, "planner_ms_p50": 9.0,
        "shortest_m": 6.2, "shortest_s": 6.0, "bound_m": 8.1, "bound_s": 1.5,
        "trajectory": trajectory(40 if ours else 0), "scene": recipe(scene(), SIZE, GOAL),
    } | fields  # fmt: skip


def drives(seeds: int = 3):
    return [drive(seed, method) for seed in range(seeds) for method in METHODS]


def results_file(path: Path, missions=None, title: str = "two methods") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    results_store.write(path, drives() if missions is None else missions, title)
    return path
