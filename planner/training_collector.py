"""Episodes for a training, driven by a policy with noise, here or in a process of their own."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import queue
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Protocol

import gymnasium
import numpy as np
import torch

from planner.attention_cost import attention_map, cost_map
from planner.environment import action_of
from planner.methods import Method, make_method
from planner.networks import Actor, Architecture
from planner.replay import Episode
from planner.reward import normalised_return
from scenes.pose import Pose
from scenes.scenario import Scenario

PARENT_PERIOD_S = 0.5
"""Between looks, while held, whether there is anybody left to go on for."""


class CollectionError(RuntimeError):
    """An episode that could not be driven; the message says why."""


@dataclass(frozen=True)
class EpisodeOrder:
    """What to drive.

    noise : standard deviation added to the policy's actions; None for random ones instead
    options : of the environment's reset
    weights : of the policy, by name
    frames_every : steps between `StepFrame`s, 0 for none
    demonstrator : the method that drives in the policy's place, None for the policy
    following : seed and options of the next order, where they are known, to make its ground ahead
    """

    number: int
    seed: int
    steps: int
    noise: float | None
    options: Mapping[str, Any]
    weights: Mapping[str, np.ndarray]
    frames_every: int = 0
    demonstrator: str | None = None
    following: tuple[int, Mapping[str, Any]] | None = None


@dataclass(frozen=True)
class StepFrame:
    """What a policy in training did and saw at a step, for those who watch.

    pose : the true one, after it
    layers : (n, 40, 40) all that the environment showed; the network reads the first `channels` of them
    attention, cost : (40, 40) summed over the channels after the attention; the cost map read off it
    scenario : the ground it drives on, with the first frame of an episode only
    """

    episode: int
    step: int
    pose: Pose
    action: tuple[float, float]
    reward: float
    layers: np.ndarray
    attention: np.ndarray
    cost: np.ndarray
    scenario: Scenario | None = None


@dataclass(frozen=True)
class Collected:
    """An episode for the learner, and how it went.

    terms : the sum of every term of the reward; final : the last step's status
    normalised : `planner.reward.normalised_return`, None of an environment that does not tell what it needs
    """

    number: int
    episode: Episode
    total: float
    terms: dict[str, float]
    success: bool
    exposed_s: float
    final: str
    normalised: float | None


class Gate(Protocol):
    """What a collector asks between steps: it holds while a training is paused."""

    def wait(self, timeout: float | None = None) -> bool: ...


@dataclass
class Collector:
    """Drives episodes of one environment, as `gymnasium.make` gives it by its name and options."""

    environment: str
    options: Mapping[str, Any]
    architecture: Architecture
    _env: gymnasium.Env | None = field(default=None, repr=False)

    def collect(self, order: EpisodeOrder, gate: Gate | None = None) -> Iterator[StepFrame | Collected]:
        """The frames asked for, then the episode. The order alone decides how it goes.

        Raises CollectionError where the environment refuses, and for a reward that is not finite, naming the
        term."""
        env, drive = self._made(), _Drive(self.architecture, order)
        try:
            observation, _ = env.reset(seed=order.seed, options=dict(order.options))
        except ValueError as error:
            raise CollectionError(f"episode {order.number} cannot begin: {error}") from error
        drive.saw(observation)
        planner = None if order.demonstrator is None else make_method(order.demonstrator, order.seed)
        info: dict[str, Any] = {}
        for step in range(order.steps):
            if gate is not None:
                gate.wait()
            action = drive.act() if planner is None else _demonstrated(env, planner)
            observation, reward, terminated, truncated, info = env.step(action)
            _check(info.get("terms", {}) | {"total": float(reward)}, step, order.number)
            drive.did(action, float(reward), terminated, info)
            if order.frames_every and step % order.frames_every == 0:
                scenario = getattr(env.unwrapped, "scenario", None) if step == 0 else None
                yield drive.frame(step, info["pose"], scenario)
            drive.saw(observation)
            if terminated or truncated:
                break
        yield drive.collected(info)

    def prepare(self, order: EpisodeOrder) -> None:
        """While nothing else is asked for: make what the episode after this one needs, where the environment
        can."""
        make_ahead = getattr(self._made().unwrapped, "prepare", None)
        if make_ahead is not None and order.following is not None:
            seed, options = order.following
            with contextlib.suppress(ValueError):  # the order itself will say so
                make_ahead(seed=seed, options=dict(options))

    def _made(self) -> gymnasium.Env:
        if self._env is None:
            try:
                self._env = gymnasium.make(self.environment, disable_env_checker=True, **dict(self.options))
            except (TypeError, ValueError, gymnasium.error.Error) as error:
                raise CollectionError(f"{self.environment} cannot be made: {error}") from error
        return self._env

    def close(self) -> None:
        """Free the environment; safe to call twice."""
        if self._env is not None:
            self._env.close()
            self._env = None


class _Drive:
    """An episode on its way: the policy, its noise, and what was seen and done so far."""

    def __init__(self, architecture: Architecture, order: EpisodeOrder):
        self._architecture, self._order = architecture, order
        self._actor = Actor(architecture).eval()
        self._actor.load_state_dict({k: torch.from_numpy(np.array(v)) for k, v in order.weights.items()})
        self._rng = np.random.default_rng([order.seed, 1])
        self._shown = np.zeros(0, np.float32)
        self._layers: list[np.ndarray] = []
        self._states: list[np.ndarray] = []
        self._actions: list[np.ndarray] = []
        self._rewards: list[float] = []
        self._terminal: list[bool] = []
        self._terms: dict[str, float] = {}
        self._extremes: tuple[float, float] | None = None  # most hidden and least visible so far

    def saw(self, observation: Mapping[str, np.ndarray]) -> None:
        self._shown = observation["layers"]
        self._layers.append(observation["layers"][: self._architecture.channels].astype(np.float16))
        self._states.append(np.asarray(observation["state"][: self._architecture.state], np.float32))

    @torch.inference_mode()
    def act(self) -> np.ndarray:
        if self._order.noise is None:
            return self._rng.uniform(-1.0, 1.0, 2).astype(np.float32)
        layers = torch.from_numpy(self._layers[-1][None].astype(np.float32))
        action = self._actor(layers, torch.from_numpy(self._states[-1][None]))[0].numpy()
        noise = self._order.noise * self._rng.standard_normal(2)
        return np.clip(action + noise, -1.0, 1.0).astype(np.float32)

    def did(self, action: np.ndarray, reward: float, terminal: bool, info: Mapping[str, Any]) -> None:
        self._actions.append(action)
        self._rewards.append(reward)
        self._terminal.append(terminal)
        for name, value in info.get("terms", {}).items():
            if name != "total":
                self._terms[name] = self._terms.get(name, 0.0) + float(value)
        if "hidden" in info and "visibility" in info:
            most, least = self._extremes or (0.0, 1.0)
            self._extremes = max(most, float(info["hidden"])), min(least, float(info["visibility"]))

    @torch.inference_mode()
    def frame(self, step: int, pose: Pose, scenario: Scenario | None) -> StepFrame:
        """Of the observation that the newest action was chosen on."""
        layers = self._layers[-1].astype(np.float32)
        attended = self._actor.encoder.attend(torch.from_numpy(layers[None]))[0].numpy()
        forward, turn = self._actions[-1].tolist()
        return StepFrame(
            self._order.number, step, pose, (forward, turn), self._rewards[-1], self._shown,
            attention_map(attended), cost_map(attended, layers[0]), scenario,
        )  # fmt: skip

    def collected(self, info: Mapping[str, Any]) -> Collected:
        episode = Episode(
            np.stack(self._layers),
            np.stack(self._states),
            np.stack(self._actions),
            np.array(self._rewards, np.float32),
            np.array(self._terminal, bool),
        )
        total = float(sum(self._rewards))
        return Collected(
            self._order.number,
            episode,
            total,
            self._terms,
            bool(info["success"]),
            float(info["exposed_s"]),
            str(info["status"]),
            None if self._extremes is None else normalised_return(total, *self._extremes),
        )


def _demonstrated(env: gymnasium.Env, method: Method) -> np.ndarray:
    """The action that comes nearest to what a method commands now."""
    percept = getattr(env.unwrapped, "percept", None)
    if percept is None:
        raise CollectionError("demonstrations are for environments that say what a planner needs to know")
    return action_of(method.decide(percept).command)


def _check(terms: Mapping[str, float], step: int, episode: int) -> None:
    for name, value in terms.items():
        if not np.isfinite(value):
            where = f"in step {step} of episode {episode}"
            raise CollectionError(f"the reward's term {name!r} became {value} {where}")


class CollectorProcess:
    """A `Collector` in a process of its own, so that driving and learning use a core each. It ends when told,
    and when whoever started it is gone."""

    def __init__(self, collector: Collector):
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._open = context.Event()
        self._open.set()
        self._process = context.Process(target=_serve, args=(theirs, self._open, collector), daemon=True)
        self._process.start()
        theirs.close()

    def begin(self, order: EpisodeOrder) -> None:
        """Have an episode driven, for `poll` to fetch. Raises CollectionError where the process is gone."""
        try:
            self._pipe.send(order)
        except OSError:
            raise self._gone() from None

    def poll(self, timeout: float = 0.0) -> StepFrame | Collected | None:
        """What came in, waiting at most `timeout` seconds. Raises CollectionError for an episode that could
        not be driven."""
        try:
            if not self._pipe.poll(timeout):
                return None
            message = self._pipe.recv()
        except (EOFError, OSError):
            raise self._gone() from None
        if isinstance(message, CollectionError):
            raise message
        return message

    def pause(self) -> None:
        """Hold after the step that is being driven."""
        self._open.clear()

    def go_on(self) -> None:
        self._open.set()

    def close(self) -> None:
        """End the process; safe to call twice."""
        self._pipe.close()
        if self._process.is_alive():
            self._process.terminate()
        self._process.join()

    def _gone(self) -> CollectionError:
        self._process.join(1.0)
        return CollectionError(f"the process that drives has ended (exit {self._process.exitcode})")


class _WhileServed:
    """A gate that is given up once the process that would open it is gone."""

    def __init__(self, gate: Gate):
        self._gate, self._parent = gate, os.getppid()

    def wait(self, timeout: float | None = None) -> bool:
        """Raises EOFError once nobody is left to open it."""
        while not self._gate.wait(PARENT_PERIOD_S):
            if os.getppid() != self._parent:
                raise EOFError
        return True


class _Orders:
    """The orders that come in, taken off the pipe at once: it holds less than a policy, and whoever sends one
    must not wait until the ground ahead is made."""

    def __init__(self, pipe: Connection):
        self._pipe = pipe
        self._taken: queue.SimpleQueue[EpisodeOrder | None] = queue.SimpleQueue()
        threading.Thread(target=self._take, name="orders", daemon=True).start()

    def __iter__(self) -> Iterator[EpisodeOrder]:
        """Until nobody is left to give any."""
        while (order := self._taken.get()) is not None:
            yield order

    @property
    def waiting(self) -> bool:
        return not self._taken.empty()

    def _take(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                self._taken.put(self._pipe.recv())
        self._taken.put(None)


def _serve(pipe: Connection, gate: Gate, collector: Collector) -> None:
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the learner's to answer
    torch.set_num_threads(1)
    held, orders = _WhileServed(gate), _Orders(pipe)
    try:
        for order in orders:
            try:
                for item in collector.collect(order, held):
                    pipe.send(item)
                if not orders.waiting:
                    collector.prepare(order)
            except CollectionError as error:
                pipe.send(error)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        pass
    finally:
        collector.close()
