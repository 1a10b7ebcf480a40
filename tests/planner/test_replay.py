"""The buffer: what goes in comes out in transitions that belong together, the oldest lost first."""

import numpy as np
import pytest

from planner.learning_errors import PolicyError
from planner.replay import Episode, Replay


def episode(first, steps, terminal=False):
    """Observations numbered from `first` on, which its rewards repeat."""
    numbers = first + np.arange(steps + 1)
    layers = np.broadcast_to(numbers[:, None, None, None], (steps + 1, 1, 40, 40)).astype(np.float16)
    state = np.repeat(numbers[:, None], 3, 1).astype(np.float32)
    ends = np.zeros(steps, bool)
    ends[-1] = terminal
    return Episode(layers, state, np.zeros((steps, 2), np.float32), numbers[:-1].astype(np.float32), ends)


def drawn(replay, count=2000):
    return replay.sample(count, np.random.default_rng(0))


def test_every_transition_is_drawn_with_what_follows_it():
    replay = Replay(100, 1, 3)
    replay.add(episode(0, 4))
    replay.add(episode(10, 3, terminal=True))
    batch = drawn(replay)
    assert len(replay) == 7
    assert set(batch.reward.tolist()) == {0, 1, 2, 3, 10, 11, 12}
    assert (batch.next_state[:, 0] == batch.reward + 1).all() and (batch.state[:, 0] == batch.reward).all()
    assert (batch.next_layers[:, 0, 5, 5] == batch.layers[:, 0, 5, 5] + 1).all()
    assert ((batch.terminal == 1.0) == (batch.reward == 12)).all()


def test_the_oldest_are_overwritten_and_no_transition_spans_two_episodes():
    replay = Replay(20, 1, 3)
    for number in range(7):
        replay.add(episode(100 * number, 5 + number % 3))
    batch = drawn(replay)
    assert (batch.next_state[:, 0] == batch.state[:, 0] + 1).all()
    assert 600 in batch.reward and batch.reward.min() >= 300
    assert replay.newest == 5


def test_the_same_seed_draws_the_same():
    replay = Replay(100, 1, 3)
    replay.add(episode(0, 50))
    assert drawn(replay).reward.tolist() == drawn(replay).reward.tolist()


def test_100000_observations_of_the_paper_fit_in_a_third_of_a_gigabyte():
    replay = Replay(100_000, 1, 25)
    assert replay._layers.nbytes < 0.33e9


def test_episodes_that_do_not_fit_are_refused():
    replay = Replay(10, 1, 3)
    with pytest.raises(ValueError, match="10 steps does not fit"):
        replay.add(episode(0, 10))
    with pytest.raises(ValueError, match=r"observations are \(1, 40, 40\) and \(3,\)"):
        Replay(100, 1, 4).add(episode(0, 5))


def test_an_episode_comes_back_from_its_file_as_it_was(tmp_path):
    given = episode(0, 4, terminal=True)
    given.save(tmp_path / "e.safetensors")
    found = Episode.load(tmp_path / "e.safetensors")
    for name, array in vars(given).items():
        assert np.array_equal(getattr(found, name), array) and getattr(found, name).dtype == array.dtype


def test_half_an_episode_is_refused(tmp_path):
    path = tmp_path / "e.safetensors"
    episode(0, 4).save(path)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(PolicyError, match="truncated"):
        Episode.load(path)
