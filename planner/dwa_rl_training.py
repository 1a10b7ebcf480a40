"""Teaches DWA-RL's policy by proximal policy optimisation (Schulman et al. 2017), in one process.

All follows from the seed: the drives, the choices and the batches. Now and then the policy drives
where it never learns, always by its likeliest row, and the one that did best there is kept; the first to
be judged so is the policy that has learnt nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from planner.dwa_rl import Window
from planner.dwa_rl_network import WindowPolicy, save_window_policy
from planner.dwa_rl_window import CHANNELS
from planner.dwa_rl_world import CrossingWorld
from planner.frames import Status
from planner.learning_errors import check_finite

_LEARNING_STREAM, _JUDGING_STREAM, _TEST_STREAM = 1, 2, 3


@dataclass(frozen=True)
class MotionLessons:
    """decisions : to learn from; worlds : driven in turn; round : decisions of each between updates
    rate : Adam's, falling to 0; discount, trace : γ and λ of the advantages; clip : of the probability ratio
    epochs, batch : of each update; entropy, value : weights of their terms; most : norm of a gradient
    judged_every : rounds from one judging to the next, over `judged` drives
    """

    decisions: int = 60_000
    seed: int = 0
    worlds: int = 16
    round: int = 128
    rate: float = 1e-3
    discount: float = 0.99
    trace: float = 0.95
    clip: float = 0.2
    epochs: int = 3
    batch: int = 256
    entropy: float = 0.003
    value: float = 0.5
    most: float = 0.5
    judged_every: int = 7
    judged: int = 48

    @property
    def rounds(self) -> int:
        return max(1, self.decisions // (self.worlds * self.round))


@dataclass(frozen=True)
class Judged:
    """How drives went that are not learnt from: shares of them, and mean seconds of those that arrived."""

    success: float
    collisions: float
    seconds: float

    @property
    def rank(self) -> tuple[float, float, float]:
        """Less is better."""
        return -self.success, self.collisions, self.seconds


@dataclass(frozen=True)
class Round:
    """After so many decisions: mean reward of a drive and share that arrived since the last round; `judged`
    where it was, and whether that is the best so far."""

    decisions: int
    total: float
    success: float
    judged: Judged | None = None
    best: bool = False


def choose_by(policy: WindowPolicy) -> Callable[[Window], int]:
    """The policy's likeliest row."""

    def choose(window: Window) -> int:
        with torch.inference_mode():
            logits, _ = policy(
                torch.from_numpy(window.view.tensor[None]), torch.from_numpy(window.admissible[None])
            )
        return int(logits[0].argmax())

    return choose


def choose_by_weights(window: Window) -> int:
    """The dynamic window's own choice among the same velocities, by its weighted terms."""
    total = window.rollout.arcs.total[window.view.order]
    return int(np.argmin(np.where(window.admissible, total, np.inf)))


def judge(
    choose: Callable[[Window], int], drives: int, seed: int, stream: int = _JUDGING_STREAM
) -> Judged:
    """Drive in the world of the training; the same drives for the same seed and stream."""
    ends, seconds = Counter(), []
    for index in range(drives):
        world = CrossingWorld(np.random.default_rng([seed, stream, index]))
        while not world.over:
            world.step(choose(world.window))
        ends[world.status] += 1
        if world.status is Status.REACHED:
            seconds.append(world.seconds)
    return Judged(
        ends[Status.REACHED] / drives,
        ends[Status.COLLIDED] / drives,
        float(np.mean(seconds)) if seconds else float("inf"),
    )


def compare(policy: WindowPolicy, drives: int, seed: int) -> dict[str, Judged]:
    """The policy, and the dynamic window's own choice in its place, on drives that decided nothing in a
    training of that seed."""
    choices = {"dwa_rl": choose_by(policy), "dwa": choose_by_weights}
    return {name: judge(choose, drives, seed, _TEST_STREAM) for name, choose in choices.items()}


def teach_motion(path: Path, lessons: MotionLessons | None = None) -> Iterator[Round]:
    """Learn, keeping the best policy in `path`; yields each round. Raises OSError."""
    lessons = lessons or MotionLessons()
    torch.set_num_threads(1)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(lessons.seed)
        policy = WindowPolicy()
    optimiser = torch.optim.Adam(policy.parameters(), lessons.rate, eps=1e-5)
    draws = torch.Generator().manual_seed(lessons.seed)
    streams = [[lessons.seed, _LEARNING_STREAM, index] for index in range(lessons.worlds)]
    worlds = [CrossingWorld(np.random.default_rng(stream)) for stream in streams]
    best = judge(choose_by(policy), lessons.judged, lessons.seed)
    save_window_policy(path, policy)
    yield Round(0, 0.0, 0.0, best, True)
    totals = np.zeros(lessons.worlds)
    for number in range(1, lessons.rounds + 1):
        optimiser.param_groups[0]["lr"] = lessons.rate * (1.0 - (number - 1) / lessons.rounds)
        gathered, ended = _gather(policy, worlds, totals, lessons, draws)
        _update(policy, optimiser, gathered, lessons, draws)
        judged, better = None, False
        if number % lessons.judged_every == 0 or number == lessons.rounds:
            judged = judge(choose_by(policy), lessons.judged, lessons.seed)
            better = judged.rank < best.rank
        if judged is not None and better:
            best = judged
            save_window_policy(path, policy)
        arrived = [status is Status.REACHED for _, status in ended]
        yield Round(
            number * lessons.worlds * lessons.round,
            float(np.mean([total for total, _ in ended])) if ended else 0.0,
            float(np.mean(arrived)) if ended else 0.0,
            judged,
            better,
        )


@dataclass(frozen=True)
class _Gathered:
    """Of (round × worlds) decisions: what was seen, chosen, and how it turned out."""

    tensor: Tensor
    admissible: Tensor
    row: Tensor
    chance: Tensor
    advantage: Tensor
    returned: Tensor


def _gather(
    policy: WindowPolicy,
    worlds: list[CrossingWorld],
    totals: np.ndarray,
    lessons: MotionLessons,
    draws: torch.Generator,
) -> tuple[_Gathered, list[tuple[float, Status]]]:
    count, shape = len(worlds), policy.architecture
    tensor = torch.empty(lessons.round, count, shape.rows, shape.sets, len(CHANNELS))
    admissible = torch.empty(lessons.round, count, shape.rows, dtype=torch.bool)
    row = torch.empty(lessons.round, count, dtype=torch.long)
    chance, value, reward, over = (torch.empty(lessons.round, count) for _ in range(4))
    ended: list[tuple[float, Status]] = []
    for tick in range(lessons.round):
        tensor[tick], admissible[tick] = _seen(worlds)
        with torch.inference_mode():
            logits, value[tick] = policy(tensor[tick], admissible[tick])
            likely = functional.log_softmax(logits, 1)
            row[tick] = torch.multinomial(likely.exp(), 1, generator=draws).squeeze(1)
            chance[tick] = likely.gather(1, row[tick, :, None]).squeeze(1)
        for index, world in enumerate(worlds):
            paid = world.step(int(row[tick, index]))
            reward[tick, index], over[tick, index] = paid, float(world.over)
            totals[index] += paid
            if world.over:
                ended.append((float(totals[index]), world.status))
                totals[index] = 0.0
                world.reset()
    with torch.inference_mode():
        _, following = policy(*_seen(worlds))
    advantage = _advantages(reward, value, over, following, lessons)
    flat = (each.flatten(0, 1) for each in (tensor, admissible, row, chance, advantage, advantage + value))
    return _Gathered(*flat), ended


def _seen(worlds: list[CrossingWorld]) -> tuple[Tensor, Tensor]:
    tensors = np.stack([world.window.view.tensor for world in worlds])
    admissible = np.stack([world.window.admissible for world in worlds])
    return torch.from_numpy(tensors), torch.from_numpy(admissible)


def _advantages(
    reward: Tensor, value: Tensor, over: Tensor, following: Tensor, lessons: MotionLessons
) -> Tensor:
    """Generalised advantage estimates (Schulman et al. 2016) of (ticks, worlds) decisions."""
    advantage, trace = torch.empty_like(reward), torch.zeros(reward.shape[1])
    for tick in reversed(range(len(reward))):
        goes_on = 1.0 - over[tick]
        error = reward[tick] + lessons.discount * goes_on * following - value[tick]
        trace = error + lessons.discount * lessons.trace * goes_on * trace
        advantage[tick], following = trace, value[tick]
    return advantage


def _update(
    policy: WindowPolicy,
    optimiser: torch.optim.Optimizer,
    given: _Gathered,
    lessons: MotionLessons,
    draws: torch.Generator,
) -> None:
    for _ in range(lessons.epochs):
        for part in torch.randperm(len(given.row), generator=draws).split(lessons.batch):
            logits, value = policy(given.tensor[part], given.admissible[part])
            likely = functional.log_softmax(logits, 1)
            ratio = (likely.gather(1, given.row[part, None]).squeeze(1) - given.chance[part]).exp()
            advantage = given.advantage[part]
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            clipped = ratio.clamp(1.0 - lessons.clip, 1.0 + lessons.clip)
            gain = torch.minimum(ratio * advantage, clipped * advantage).mean()
            spread = -(likely.exp() * likely.clamp_min(-1e3)).sum(1).mean()
            off = functional.mse_loss(value, given.returned[part])
            terms = {"value": off.item(), "gain": gain.item(), "entropy": spread.item()}
            check_finite(terms, "the last round")
            loss = lessons.value * off - gain - lessons.entropy * spread
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(policy.parameters(), lessons.most)
            optimiser.step()
