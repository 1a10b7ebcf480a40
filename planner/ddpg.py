"""Deep deterministic policy gradient, Lillicrap et al. 2016, with the CoverNav paper's settings.

Actor and critic take their steps from the same parameters and the same batch, so that the critic looks at
each batch once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from planner.checkpoint import load_weights, weights
from planner.networks import PAPER, Actor, Architecture, Critic
from planner.replay import Batch


@dataclass(frozen=True)
class DdpgConfig:
    """The paper's settings; those it leaves open are TERP's.

    actor_rate, critic_rate : Adam's; TERP's are 1e-4 and 1e-3
    batch : transitions an update; buffer : observations kept
    discount : γ; soft_update : τ, share of the networks that their targets take over at each update (TERP)
    noise : standard deviation added to each action while collecting
    """

    actor_rate: float = 1e-4
    critic_rate: float = 1e-4
    betas: tuple[float, float] = (0.9, 0.999)
    batch: int = 64
    buffer: int = 100_000
    discount: float = 0.99
    soft_update: float = 1e-3
    noise: float = 0.1


@dataclass(frozen=True)
class Losses:
    """critic : mean squared error of the values; actor : less the mean value of its actions."""

    critic: float = math.nan
    actor: float = math.nan


class LossError(ArithmeticError):
    """A loss that is not a finite number; `term` is "critic loss" or "actor loss"."""

    def __init__(self, term: str, value: float):
        super().__init__(f"the {term} became {value}")
        self.term = term


class Ddpg:
    """Actor, critic, their slow targets, and both optimisers. Same seed and batches, same parameters, bit for
    bit, on one thread of the same machine."""

    def __init__(self, architecture: Architecture = PAPER, config: DdpgConfig | None = None, seed: int = 0):
        self.config = config or DdpgConfig()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.actor, self.critic = Actor(architecture), Critic(architecture)
        self.target_actor, self.target_critic = Actor(architecture), Critic(architecture)
        self.target_actor.load_state_dict(self.actor.state_dict())
        self.target_critic.load_state_dict(self.critic.state_dict())
        self._parameters = tuple(self.actor.parameters()), tuple(self.critic.parameters())
        rates = self.config.actor_rate, self.config.critic_rate
        self._optimisers = tuple(
            torch.optim.Adam(parameters, rate, self.config.betas, fused=True)
            for parameters, rate in zip(self._parameters, rates, strict=True)
        )
        self._beside = ThreadPoolExecutor(1, "critic", torch.set_num_threads, (1,))

    def update(self, batch: Batch) -> Losses:
        """One step of both networks, then of their targets. Raises LossError, leaving all as it was.

        What the critic learns from is computed beside what the actor does, on a thread of its own."""
        targets = self._beside.submit(self._targets, batch)
        features = self.critic.encoder(batch.layers, batch.state)
        of_critic = self._beside.submit(self._critic_step, features, batch, targets)
        action = self.actor(batch.layers, batch.state)
        actor_loss = -self.critic.value(features.detach(), action).mean()
        actor_gradients = torch.autograd.grad(actor_loss, self._parameters[0])
        critic_loss, critic_gradients = of_critic.result()
        losses = Losses(critic_loss, float(actor_loss.detach()))
        for term, value in (("critic loss", losses.critic), ("actor loss", losses.actor)):
            if not math.isfinite(value):
                raise LossError(term, value)
        gradients = actor_gradients, critic_gradients
        for parameters, slopes, optimiser in zip(self._parameters, gradients, self._optimisers, strict=True):
            for parameter, slope in zip(parameters, slopes, strict=True):
                parameter.grad = slope
            optimiser.step()
        self._follow()
        return losses

    def _critic_step(
        self, features: Tensor, batch: Batch, targets: Future[Tensor]
    ) -> tuple[float, tuple[Tensor, ...]]:
        """Its loss, and the gradients of that."""
        loss = functional.mse_loss(self.critic.value(features, batch.action), targets.result())
        return float(loss.detach()), torch.autograd.grad(loss, self._parameters[1])

    @torch.no_grad()
    def _targets(self, batch: Batch) -> Tensor:
        action = self.target_actor(batch.next_layers, batch.next_state)
        following = self.target_critic(batch.next_layers, batch.next_state, action)
        return batch.reward + self.config.discount * (1.0 - batch.terminal) * following

    @torch.no_grad()
    def _follow(self) -> None:
        for target, network in ((self.target_actor, self.actor), (self.target_critic, self.critic)):
            for slow, fast in zip(target.parameters(), network.parameters(), strict=True):
                slow.lerp_(fast, self.config.soft_update)

    # --- saving ----------------------------------------------------------------------------------

    @property
    def _networks(self) -> dict[str, nn.Module]:
        return {
            "actor": self.actor,
            "critic": self.critic,
            "target_actor": self.target_actor,
            "target_critic": self.target_critic,
        }

    def tensors(self) -> dict[str, np.ndarray]:
        """All that the learner knows, by name."""
        found = {
            f"{name}/{part}": tensor
            for name, network in self._networks.items()
            for part, tensor in weights(network).items()
        }
        for name, optimiser in zip(("actor", "critic"), self._optimisers, strict=True):
            for index, state in optimiser.state_dict()["state"].items():
                found |= {f"adam_{name}/{index}/{key}": value.numpy().copy() for key, value in state.items()}
        return found

    def restore(self, tensors: Mapping[str, np.ndarray], path: Path) -> None:
        """Take over what `tensors` gave; `path` is for the words of a PolicyError."""
        groups: dict[str, dict[str, np.ndarray]] = {}
        for name, tensor in tensors.items():
            group, _, part = name.partition("/")
            groups.setdefault(group, {})[part] = tensor
        for name, network in self._networks.items():
            load_weights(network, groups.get(name, {}), path)
        for name, optimiser in zip(("actor", "critic"), self._optimisers, strict=True):
            state: dict[int, dict[str, Tensor]] = {}
            for part, tensor in groups.get(f"adam_{name}", {}).items():
                index, _, key = part.partition("/")
                state.setdefault(int(index), {})[key] = torch.from_numpy(tensor.copy())
            optimiser.load_state_dict(optimiser.state_dict() | {"state": state})
