"""The learner: it learns, the same each time, and stops at the first loss that is no number."""

from pathlib import Path

import numpy as np
import pytest
import torch

from planner.ddpg import Ddpg, DdpgConfig, LossError, Losses
from planner.replay import Batch

CONFIG = DdpgConfig(actor_rate=1e-3, critic_rate=1e-3, soft_update=0.01)


def batch(seed=0, reward=None, terminal=1.0):
    """An action is worth the more the nearer it is to (0.5, -0.5), unless told, and then it is over."""
    generator = torch.Generator().manual_seed(seed)
    layers = torch.randn(64, 1, 40, 40, generator=generator)
    state = torch.randn(64, 25, generator=generator)
    action = 2.0 * torch.rand(64, 2, generator=generator) - 1.0
    worth = -((action[:, 0] - 0.5) ** 2) - (action[:, 1] + 0.5) ** 2
    given = worth if reward is None else torch.full((64,), reward)
    return Batch(layers, state, action, given, torch.full((64,), terminal), layers, state)


def same(one, other):
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


def test_the_settings_are_the_papers():
    config = DdpgConfig()
    assert (config.actor_rate, config.critic_rate, config.betas) == (1e-4, 1e-4, (0.9, 0.999))
    assert (config.batch, config.buffer, config.discount, config.noise) == (64, 100_000, 0.99, 0.1)


def test_it_finds_the_action_that_is_worth_most():
    learner = Ddpg(config=CONFIG)
    losses = [learner.update(batch(seed)) for seed in range(150)]
    assert losses[-1].critic < 0.3 * losses[0].critic
    given = batch(1000)
    with torch.no_grad():
        action = learner.actor(given.layers, given.state).mean(0).tolist()
    assert action == pytest.approx([0.5, -0.5], abs=0.25)


def test_two_threads_learn_what_one_does_to_the_last_bit():
    """The losses and steps written down in order, as the method has them."""
    learner, plain = Ddpg(config=CONFIG, seed=3), Ddpg(config=CONFIG, seed=3)
    for seed in range(3):
        given = batch(seed)
        losses = learner.update(given)
        features = plain.critic.encoder(given.layers, given.state)
        value = plain.critic.value(features, given.action)
        critic_loss = torch.nn.functional.mse_loss(value, plain._targets(given))
        action = plain.actor(given.layers, given.state)
        actor_loss = -plain.critic.value(features.detach(), action).mean()
        slopes = [
            torch.autograd.grad(loss, parameters)
            for loss, parameters in zip((actor_loss, critic_loss), plain._parameters, strict=True)
        ]
        for index, optimiser in enumerate(plain._optimisers):
            for parameter, slope in zip(plain._parameters[index], slopes[index], strict=True):
                parameter.grad = slope
            optimiser.step()
        plain._follow()
        assert losses == Losses(critic_loss.item(), actor_loss.item())
        assert same(learner.tensors(), plain.tensors())


def test_the_targets_follow_slowly():
    learner = Ddpg(config=CONFIG)
    before = learner.target_critic.head[0].weight.clone()
    learner.update(batch())
    moved, way = learner.target_critic.head[0].weight - before, learner.critic.head[0].weight - before
    assert torch.allclose(moved, 0.01 * way, atol=1e-7)


def test_what_follows_counts_less_and_nothing_follows_the_end():
    learner = Ddpg(config=CONFIG)
    given = batch(reward=2.0, terminal=0.0)
    action = learner.target_actor(given.layers, given.state)
    following = learner.target_critic(given.layers, given.state, action)
    assert torch.allclose(learner._targets(given), 2.0 + 0.99 * following, atol=1e-6)
    assert torch.equal(learner._targets(batch(reward=2.0)), torch.full((64,), 2.0))


def test_the_same_seed_and_batches_give_the_same_numbers():
    one, other = Ddpg(config=CONFIG, seed=3), Ddpg(config=CONFIG, seed=3)
    for seed in range(3):
        one.update(batch(seed)), other.update(batch(seed))
    assert same(one.tensors(), other.tensors())
    assert not same(Ddpg(seed=4).tensors(), Ddpg(seed=3).tensors())


def test_restored_it_goes_on_bit_for_bit():
    one, other = Ddpg(config=CONFIG, seed=0), Ddpg(config=CONFIG, seed=1)
    one.update(batch(0))
    other.restore(one.tensors(), Path("here"))
    one.update(batch(1)), other.update(batch(1))
    assert same(one.tensors(), other.tensors())


@pytest.mark.parametrize("reward", [float("nan"), float("inf"), 1e30])
def test_a_loss_that_is_no_number_is_named_and_changes_nothing(reward):
    learner = Ddpg(config=CONFIG)
    learner.update(batch())
    before = learner.tensors()
    with pytest.raises(LossError, match="the critic loss became"):
        learner.update(batch(reward=reward))
    assert same(learner.tensors(), before)
