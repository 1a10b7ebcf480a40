"""What was driven, to learn from: episodes, kept small, and drawn from at random."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from planner.checkpoint import read_tensors, write_tensors
from planner.learning_errors import PolicyError


@dataclass(frozen=True)
class Episode:
    """One drive of t steps; t + 1 observations.

    layers : (t + 1, channels, 40, 40) float16; state : (t + 1, state) float32
    action : (t, 2) float32; reward : (t,) float32
    terminal : (t,) bool, where nothing follows; a drive that the step limit cuts off does not end so
    """

    layers: np.ndarray
    state: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    terminal: np.ndarray

    def __len__(self) -> int:
        return len(self.reward)

    def save(self, path: Path) -> None:
        """Write a safetensors file, whole or not at all. Raises OSError."""
        write_tensors(path, vars(self))

    @classmethod
    def load(cls, path: Path) -> Episode:
        """Raises PolicyError where the file is not a whole episode."""
        tensors, _, _ = read_tensors(path)
        try:
            return cls(**tensors)
        except TypeError:
            raise PolicyError(f"{path} is not an episode of a training") from None


@dataclass(frozen=True)
class Batch:
    """Transitions, n of them: layers (n, channels, 40, 40), state (n, state), action (n, 2), reward (n,),
    terminal (n,) 0 or 1; all float32."""

    layers: Tensor
    state: Tensor
    action: Tensor
    reward: Tensor
    terminal: Tensor
    next_layers: Tensor
    next_state: Tensor


class Replay:
    """The newest `capacity` observations, oldest overwritten first. Layers in half precision, and each
    observation once for the step it ends and the step it begins: 100,000 of the paper's take 0.3 GB, and of
    all six layers 1.9 GB, which the system gives as they fill. `newest` is the steps of the last episode.
    """

    def __init__(self, capacity: int, channels: int, state: int):
        self.capacity = capacity
        self._layers = np.zeros((capacity, channels, 40, 40), np.float16)
        self._state = np.zeros((capacity, state), np.float32)
        self._action = np.zeros((capacity, 2), np.float32)
        self._reward = np.zeros(capacity, np.float32)
        self._terminal = np.zeros(capacity, np.float32)
        self._begins = np.zeros(capacity, bool)
        self._head, self.newest = 0, 0
        self._drawable = np.zeros(0, np.int64)

    def __len__(self) -> int:
        """How many transitions there are to draw from."""
        return len(self._drawable)

    def add(self, episode: Episode) -> None:
        """Take in an episode. Raises ValueError for one that does not fit."""
        steps = len(episode)
        if steps >= self.capacity:
            raise ValueError(f"an episode of {steps} steps does not fit a buffer of {self.capacity}")
        given = episode.layers.shape[1:], episode.state.shape[1:]
        kept = self._layers.shape[1:], self._state.shape[1:]
        if given != kept:
            raise ValueError(
                f"the episode's observations are {given[0]} and {given[1]}, not {kept[0]} and {kept[1]}"
            )
        places = (self._head + np.arange(steps + 1)) % self.capacity
        self._layers[places], self._state[places] = episode.layers, episode.state
        self._action[places[:-1]], self._reward[places[:-1]] = episode.action, episode.reward
        self._terminal[places[:-1]] = episode.terminal
        self._begins[places[:-1]], self._begins[places[-1]] = True, False
        self._head, self.newest = int(places[-1] + 1) % self.capacity, steps
        self._drawable = np.flatnonzero(self._begins)

    def sample(self, size: int, rng: np.random.Generator) -> Batch:
        """Draw transitions, each as likely as the others, with replacement."""
        places = self._drawable[rng.integers(len(self._drawable), size=size)]
        after = (places + 1) % self.capacity
        return Batch(
            torch.from_numpy(self._layers[places]).float(),
            torch.from_numpy(self._state[places]),
            torch.from_numpy(self._action[places]),
            torch.from_numpy(self._reward[places]),
            torch.from_numpy(self._terminal[places]),
            torch.from_numpy(self._layers[after]).float(),
            torch.from_numpy(self._state[after]),
        )
