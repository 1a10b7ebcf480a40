"""The paper's networks: what they read, and attention that is the published one, gradient and all."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.nn import functional

from planner.attention_kernel import in_blocks, out_of_blocks
from planner.networks import PAPER, Actor, Architecture, Attention, Critic, Encoder


def published(features, w1, b1, w2, b2, kernel, bias):
    """CBAM as Woo et al. 2018 write it, operation by operation."""

    def perceptron(pooled):
        return functional.linear(torch.relu(functional.linear(pooled, w1, b1)), w2, b2)

    channels = torch.sigmoid(perceptron(features.mean((2, 3))) + perceptron(features.amax((2, 3))))
    features = features * channels[:, :, None, None]
    pooled = torch.cat([features.mean(1, keepdim=True), features.amax(1, keepdim=True)], 1)
    return features * torch.sigmoid(functional.conv2d(pooled, kernel[None], bias, padding=1))


@pytest.mark.parametrize(("kind", "near"), [(torch.float64, 1e-12), (torch.float32, 2e-4)])
def test_attention_and_its_gradient_are_the_published_ones(kind, near):
    torch.manual_seed(0)
    attention = Attention().to(kind)
    features = torch.randn(5, 8, 20, 20, dtype=kind, requires_grad=True)
    inputs = [features, *attention.parameters()]
    ours, theirs = attention(features), published(*inputs)
    slope = torch.randn_like(ours)
    assert torch.allclose(ours, theirs, atol=near)
    for a, b in zip(
        torch.autograd.grad(ours, inputs, slope), torch.autograd.grad(theirs, inputs, slope), strict=True
    ):
        assert torch.allclose(a, b, atol=near, rtol=near)


def test_of_equal_maxima_the_first_takes_the_whole_slope():
    attention = Attention()
    features = torch.ones(1, 8, 20, 20, requires_grad=True)
    attention(features).sum().backward()
    assert torch.isfinite(features.grad).all()


@given(
    down=st.integers(1, 4), across=st.integers(1, 4), channels=st.integers(1, 3), side=st.integers(1, 4)
)
def test_blocks_are_the_features_regrouped_and_back(down, across, channels, side):
    shape = (2, channels, down * side, across * side)
    features = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
    parts = features.reshape(2, channels, down, side, across, side).transpose(0, 2, 4, 1, 3, 5)
    blocks = in_blocks(features, side)
    assert np.array_equal(blocks, parts.reshape(2, down, across, channels * side * side))
    assert np.array_equal(out_of_blocks(blocks, side), features)


def test_the_encoder_s_gradient_is_that_of_the_published_convolution():
    torch.manual_seed(0)
    encoder, layers, state = Encoder(PAPER), torch.randn(3, 1, 40, 40), torch.randn(3, 25)
    second = encoder.second
    kernel = second.weight.unflatten(1, (8, 4, 4))
    seen = torch.relu(functional.conv2d(encoder.attend(layers), kernel, second.bias, stride=4))
    theirs = torch.cat([seen.permute(0, 2, 3, 1).flatten(1), encoder.vector(state)], 1)
    ours = encoder(layers, state)
    slope, parameters = torch.randn_like(ours), tuple(encoder.parameters())
    assert torch.allclose(ours, theirs, atol=1e-5)
    slopes = [torch.autograd.grad(seen, parameters, slope) for seen in (ours, theirs)]
    for a, b in zip(*slopes, strict=True):
        assert torch.allclose(a, b, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("architecture", [PAPER, Architecture(channels=6, state=27)])
def test_actions_keep_within_their_range(architecture):
    actor = Actor(architecture)
    layers = 100.0 * torch.randn(3, architecture.channels, 40, 40)
    action = actor(layers, 100.0 * torch.randn(3, architecture.state))
    assert action.shape == (3, 2) and bool((action.abs() <= 1.0).all())


def test_the_critic_gives_a_number_an_action():
    critic = Critic()
    layers, state = torch.randn(3, 1, 40, 40), torch.randn(3, 25)
    value = critic(layers, state, torch.zeros(3, 2))
    assert value.shape == (3,)
    assert not torch.equal(value, critic(layers, state, torch.ones(3, 2)))


def test_both_weigh_less_than_5_megabytes():
    for architecture in (PAPER, Architecture(6, 27)):
        networks = Actor(architecture), Critic(architecture)
        assert 4 * sum(p.numel() for network in networks for p in network.parameters()) < 5e6


def test_nothing_is_left_to_chance_when_driving():
    actor, layers, state = Actor(), torch.randn(1, 1, 40, 40), torch.randn(1, 25)
    assert torch.equal(actor(layers, state), actor(layers, state))
    assert not any(isinstance(module, torch.nn.Dropout) for module in actor.modules())


def test_what_is_attended_to_is_not_negative():
    attended = Actor().encoder.attend(torch.randn(2, 1, 40, 40))
    assert attended.shape == (2, 8, 20, 20)
    assert np.asarray(attended.detach()).min() >= 0.0
