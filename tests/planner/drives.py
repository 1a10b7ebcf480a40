"""Results of drives that nobody drove."""


def mission(seed: int, status: str = "reached", **fields):
    return {
        "terrain": "normal",
        "method": "dwa",
        "perception": "lidar",
        "seed": seed,
        "goal_distance": 12.0,
        "status": status,
        "success": status == "reached",
        "trajectory_length_m": 12.0,
        "straight_line_m": 10.0,
        "execution_time_s": 20.0,
        "cover_fraction": 0.5,
        "planner_ms_p50": 9.0,
    } | fields
