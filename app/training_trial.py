"""Checkpoints tried out in a process of their own: whether one can be used at all, and a drive with it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from scenes.scenario import Scenario

LONGEST = 400  # decisions of a drive by the network alone


class Driver(StrEnum):
    """The network's own velocities as while it learns; or the method `covernav_paper`, in which its attention
    makes the cost map and the dynamic window drives."""

    NETWORK = "network"
    METHOD = "method"


@dataclass(frozen=True, eq=False)
class Trial:
    """A drive with a checkpoint.

    points : (n, 2) metres, where it went; status : how it ended
    """

    points: np.ndarray
    status: str
    length_m: float
    duration_s: float
    exposed_s: float


def adopt_policy(path: Path, folder: Path, training: int) -> Path:
    """Copy a checkpoint to where nothing changes it any more, under a name that says what it is.

    Raises PolicyError where it cannot be used, OSError where it cannot be copied."""
    from planner.checkpoint import load_policy, read_tensors, write_file

    load_policy(path)
    episodes = read_tensors(path)[1].get("episodes", "")
    name = f"training-{training}-episode-{episodes}" if episodes.isdigit() else f"training-{training}"
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / f"{name}.safetensors"
    write_file(kept, path.read_bytes())
    return kept


def drive(scenario: Scenario, path: Path, driver: Driver, seed: int) -> Trial:
    """Drive the scenario once with a checkpoint, by the motion model: the same seed, the same drive.

    Raises PolicyError, ScenarioError."""
    if driver is Driver.NETWORK:
        return _by_the_network(scenario, path, seed)
    return _by_the_method(scenario, path, seed)


def _by_the_network(scenario: Scenario, path: Path, seed: int) -> Trial:
    import torch

    from planner.checkpoint import load_policy
    from planner.environment import DECISION_S, CoverNavEnv

    actor, _ = load_policy(path)
    reads, env = actor.architecture, CoverNavEnv(scenario=scenario, max_steps=LONGEST)
    try:
        observation, info = env.reset(seed=seed)
        poses, over = [info["pose"]], False
        while not over:
            layers, state = observation["layers"][: reads.channels], observation["state"][: reads.state]
            with torch.inference_mode():
                action = actor(torch.from_numpy(layers[None].copy()), torch.from_numpy(state[None].copy()))
            observation, _, terminated, truncated, info = env.step(action[0].numpy())
            poses.append(info["pose"])
            over = terminated or truncated
    finally:
        env.close()
    status = "timeout" if info["status"] == "running" else str(info["status"])
    points = np.array([(pose.x, pose.y) for pose in poses])
    return Trial(points, status, _length(points), DECISION_S * (len(poses) - 1), info["exposed_s"])


def _by_the_method(scenario: Scenario, path: Path, seed: int) -> Trial:
    from planner.mission import Mission
    from scenes.kinematics import KinematicWorld

    with Mission(scenario, "covernav_paper", seed, world=KinematicWorld, weights=path) as mission:
        start = mission.frame.pose
        points = [(start.x, start.y), *((frame.pose.x, frame.pose.y) for frame in mission.frames())]
        summary = mission.summary()
    return Trial(
        np.array(points), summary["status"], summary["trajectory_length_m"],
        summary["execution_time_s"], summary["exposed_s"],
    )  # fmt: skip


def _length(points: np.ndarray) -> float:
    return math.fsum(np.hypot(*np.diff(points, axis=0).T).tolist())
