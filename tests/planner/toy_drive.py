"""A drive over flat ground with the observations of CoverNav-v0 that costs next to nothing, to test trainers.

`toy_drive:ToyDrive-v0` for `gymnasium.make`.
"""

import math
import os
import time

import gymnasium
import numpy as np
from gymnasium import spaces

from planner.frames import Status
from scenes.pose import Pose


class ToyDrive(gymnasium.Env):
    """The goal lies `goal_distance` metres away; every metre nearer is worth one.

    broken_after : steps after which the reward's term `cover` is not a number, never by default
    ground_when : a path; ground that is made ahead is ready once it exists
    """

    def __init__(
        self, max_steps=100, goal_distance=3.0, broken_after=math.inf, reward_scale=1.0, ground_when=None
    ):
        self.observation_space = spaces.Dict(
            layers=spaces.Box(-5.0, 5.0, (6, 40, 40), np.float32),
            state=spaces.Box(-5.0, 5.0, (27,), np.float32),
        )
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self._max_steps, self._goal_distance, self._broken_after = max_steps, goal_distance, broken_after
        self._scale, self._driven, self._ground_when = reward_scale, 0, ground_when

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        distance = (options or {}).get("goal_distance", self._goal_distance)
        bearing = self.np_random.uniform(-np.pi, np.pi)
        self._goal = distance * np.array([np.cos(bearing), np.sin(bearing)])
        self._layers = self.np_random.normal(size=(6, 40, 40)).astype(np.float32).clip(-5.0, 5.0)
        self._pose, self._steps = np.zeros(3), 0
        return self._observation(), {}

    def prepare(self, *, seed, options=None):
        while self._ground_when is not None and not os.path.exists(self._ground_when):
            time.sleep(0.01)

    def step(self, action):
        before = self._distance()
        yaw = self._pose[2] + 0.375 * float(action[1])
        forward = 0.125 * (float(action[0]) + 1.0)
        self._pose = np.array(
            [self._pose[0] + forward * np.cos(yaw), self._pose[1] + forward * np.sin(yaw), yaw]
        )
        self._steps += 1
        self._driven += 1
        reached = self._distance() < 0.5
        cover = math.nan if self._driven > self._broken_after else 0.0
        terms = {"goal": self._scale * (before - self._distance()), "arrival": 5.0 * reached, "cover": cover}
        reward = sum(terms.values())
        info = {
            "terms": terms | {"total": reward},
            "status": Status.REACHED if reached else Status.RUNNING,
            "pose": Pose(*self._pose[:2], 0.0, yaw=self._pose[2]),
            "exposed_s": 0.25 * self._steps,
            "success": reached,
        }
        return self._observation(), reward, reached, self._steps >= self._max_steps, info

    def _distance(self):
        return float(np.hypot(*(self._goal - self._pose[:2])))

    def _observation(self):
        offset = self._goal - self._pose[:2]
        bearing = (np.arctan2(offset[1], offset[0]) - self._pose[2] + np.pi) % (2.0 * np.pi) - np.pi
        state = np.zeros(27, np.float32)
        state[:2] = self._distance() / 12.0, bearing / np.pi
        return {"layers": self._layers, "state": state}


gymnasium.register(id="ToyDrive-v0", entry_point=ToyDrive)
