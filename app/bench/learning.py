"""The bench of the learner: training against stable-baselines3's DDPG, and a policy's decision."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn

from app.bench.measure import Result, faster, interleaved
from planner.attention_cost import cost_map
from planner.networks import PAPER, Actor, Encoder
from planner.training import Trainer
from planner.training_events import EpisodeDone
from planner.training_settings import TrainingSettings

OPTIONS = {"terrain": "forest", "reward": "corrected", "dynamics": "kinematic", "exposure_layer": False}
"""The paper's network does not read the layers of exposure, and our trainer would leave them out: so does the
peer's environment."""
TURNS, WARM_UPDATES, UPDATES = 3, 150, 600
STEPS = 100  # of an episode at most
PUBLISHED_STEPS = 10_000


def training() -> Result:
    """A step of training, driving and learning, by the wall clock on all cores."""
    # Turn by turn, for the clock of a machine may change from one minute to the next; and each from its very
    # beginning, for the grounds of an environment are made when they are first driven on.
    turns = [(_own_step_ms(seed), _peer_step_ms(seed)) for seed in range(TURNS)]
    ours, peer = (float(ms) for ms in np.median(turns, axis=0))
    ratios = ", ".join(f"{theirs / own:.2f}" for own, theirs in turns)
    return faster(
        "training",
        ours,
        peer,
        "stable-baselines3 DDPG, the same environment and networks, an update a step, batches of 64",
        f"{1e3 / ours:.0f} and {1e3 / peer:.0f} steps/s, medians of {TURNS} turns of at least {UPDATES}"
        f" updates each, ratios {ratios};"
        f" {PUBLISHED_STEPS:,} would take {ours * PUBLISHED_STEPS / 6e4:.1f} min at this pace (extrapolated);"
        " both update once a step, the results differ as their random numbers do",
        "ms/step",
    )


def policy_decision() -> Result:
    """An action and the cost map from one observation."""
    actor, model = Actor(PAPER).eval(), _peer()
    observation, _ = model.get_env().envs[0].reset(seed=0)
    layers = torch.from_numpy(observation["layers"][None, : PAPER.channels])
    state = torch.from_numpy(observation["state"][None, : PAPER.state])
    actor.load_state_dict(_renamed(model.actor.state_dict()), strict=False)

    @torch.inference_mode()
    def ours() -> np.ndarray:
        action = actor(layers, state)[0].numpy()
        cost_map(actor.encoder.attend(layers)[0].numpy(), observation["layers"][0])
        return action

    ours_ms, peer_ms = interleaved(ours, lambda: model.predict(observation, deterministic=True), 60)
    return faster(
        "policy_decision",
        ours_ms,
        peer_ms,
        "stable-baselines3 predict, the same encoder, without a cost map",
        "a network of the same size; its head has no layer norm and so other numbers",
    )


def _own_step_ms(seed: int) -> float:
    """Milliseconds an update, of which there is one a step; episodes end when they end, so that what is
    counted begins and ends with one."""
    settings = TrainingSettings(episodes=1000, steps=STEPS, seed=seed, options=OPTIONS, resets=())
    begun = first = None
    with tempfile.TemporaryDirectory() as folder:
        for event in Trainer(Path(folder) / "training", settings).run():
            if not isinstance(event, EpisodeDone):
                continue
            if begun is None or first is None:
                if event.updates >= WARM_UPDATES:
                    begun, first = time.perf_counter(), event.updates
            elif event.updates - first >= UPDATES:
                return 1e3 * (time.perf_counter() - begun) / (event.updates - first)
    raise RuntimeError("the training ended before it could be measured")


def _peer_step_ms(seed: int) -> float:
    model = _peer(seed)
    model.learn(WARM_UPDATES, reset_num_timesteps=False)
    begun = time.perf_counter()
    model.learn(UPDATES, reset_num_timesteps=False)
    return 1e3 * (time.perf_counter() - begun) / UPDATES


def _peer(seed: int = 0) -> Any:
    from stable_baselines3 import DDPG
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

    class Extractor(BaseFeaturesExtractor):
        """Our encoder, on what the paper's network reads."""

        def __init__(self, space: gymnasium.Space):
            encoder = Encoder(PAPER)
            super().__init__(space, encoder.width)
            self.encoder: nn.Module = encoder

        def forward(self, observations: dict[str, Tensor]) -> Tensor:
            layers, state = observations["layers"], observations["state"]
            return self.encoder(layers[:, : PAPER.channels], state[:, : PAPER.state])

    torch.set_num_threads(1)
    return DDPG(
        "MultiInputPolicy",
        gymnasium.make("CoverNav-v0", max_steps=STEPS, **OPTIONS),  # type: ignore[arg-type]
        learning_rate=1e-4,
        buffer_size=2000,
        learning_starts=STEPS,
        batch_size=64,
        tau=1e-3,
        train_freq=1,
        gradient_steps=1,
        action_noise=NormalActionNoise(np.zeros(2), 0.1 * np.ones(2)),
        policy_kwargs={"features_extractor_class": Extractor, "net_arch": [256, 64, 30]},
        device="cpu",
        seed=seed,
    )


def _renamed(theirs: dict[str, Tensor]) -> dict[str, Tensor]:
    """The parameters of their encoder by our names."""
    start = "features_extractor."
    return {name.removeprefix(start): part for name, part in theirs.items() if name.startswith(start)}
