"""The network that corrects the sensed exposure."""

import json

import numpy as np
import pytest
import torch
from maps import grid_map
from test_sensed_exposure import EAST, known, standing

from planner import exposure_lessons
from planner.checkpoint import PolicyError, write_tensors
from planner.exposure_learning import Sample, fit, score
from planner.exposure_lessons import CARD, WEIGHTS, collect, learn, read
from planner.exposure_network import (
    CELLS,
    CHANNELS,
    LEAST,
    ExposureNetwork,
    corrected_exposure,
    load_network,
    save_network,
    turned,
    window,
)
from planner.scene_samples import Lessons
from planner.sensed_exposure import sensed_exposure

SCREEN = standing(grid_map(), lambda x, y: (abs(x - 3.0) < 0.15) & (abs(y) < 1.5))
SEEN = known(SCREEN, EAST)


def small(seed: int = 0) -> ExposureNetwork:
    torch.manual_seed(seed)
    return ExposureNetwork((8, 8, 8))


def made_up(count: int, seed: int) -> list[Sample]:
    """Samples in which the truth is what is sensed, but for things that let light through."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        layers = rng.random((len(CHANNELS), CELLS, CELLS)).astype(np.float16)
        target = np.where(layers[6] > 0.5, 1.0, layers[0])
        made.append(Sample(layers, target.astype(np.float16), np.ones((CELLS, CELLS), bool)))
    return made


def test_before_it_has_learnt_it_says_what_is_sensed() -> None:
    sensed = sensed_exposure(SEEN)
    np.testing.assert_allclose(corrected_exposure(small(), SEEN, sensed), sensed, atol=LEAST + 1e-6)


def test_without_observers_nothing_is_seen() -> None:
    alone = known(SCREEN)
    assert not corrected_exposure(small(), alone, sensed_exposure(alone)).any()


def test_what_it_reads_is_where_it_stands_on_the_map() -> None:
    part = window(SEEN, sensed_exposure(SEEN))
    assert part.layers.shape == (len(CHANNELS), CELLS, CELLS)
    assert np.isfinite(part.layers).all()
    obstacle = part.layers[CHANNELS.index("obstacle")]
    np.testing.assert_array_equal(obstacle > 0, SCREEN.obstacle[np.ix_(part.rows, part.cols)])
    row, col = CELLS // 2, CELLS // 2
    east = part.layers[CHANNELS.index("bearing cosine"), row, col]
    assert east == pytest.approx(1.0, abs=0.01)


def test_learning_makes_it_better_on_what_it_has_not_seen() -> None:
    network = small()
    before = score(network, made_up(4, 9))
    *_, after = fit(network, made_up(24, 1), made_up(4, 9), epochs=12, seed=0, rate=1e-2, batch=8)
    assert after.brier < 0.9 * before.brier
    assert after.sensed_brier == pytest.approx(before.sensed_brier)


def test_weights_come_back_as_they_were_saved(tmp_path) -> None:
    network = small(3)
    named = save_network(tmp_path / "w.safetensors", network)
    again, name = load_network(tmp_path / "w.safetensors")
    assert name == named and again.widths == network.widths
    for one, other in zip(network.parameters(), again.parameters(), strict=True):
        assert torch.equal(one, other)


def test_what_is_no_such_network_is_refused_in_words(tmp_path) -> None:
    path = tmp_path / "w.safetensors"
    save_network(path, small())
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PolicyError, match="truncated"):
        load_network(path)
    write_tensors(path, {"a": np.zeros(3, np.float32)})
    with pytest.raises(PolicyError, match="architecture"):
        load_network(path)


def test_the_same_seed_learns_the_same() -> None:
    def learnt() -> list[float]:
        return [s.brier for s in fit(small(), made_up(6, 1), made_up(2, 9), epochs=2, seed=3, batch=4)]

    assert learnt() == learnt()


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("quarter", range(4))
def test_turned_layers_are_those_of_a_turned_world(quarter: int, mirrored: bool) -> None:
    rows, cols = np.indices((CELLS, CELLS)) - (CELLS - 1) / 2
    layers = np.zeros((len(CHANNELS), CELLS, CELLS), np.float32)
    # Bearings that point away from the middle, in every cell.
    radius = np.hypot(rows, cols)
    layers[8], layers[9] = cols / radius, rows / radius
    out = turned(layers, quarter, mirrored)
    np.testing.assert_allclose(out[8], layers[8], atol=1e-6)
    np.testing.assert_allclose(out[9], layers[9], atol=1e-6)
    alone = turned(layers[8:9], quarter, mirrored)  # a target has no bearings: it is only turned
    assert np.abs(alone).sum() == pytest.approx(np.abs(layers[8]).sum())


def test_a_training_keeps_its_best_weights_and_goes_on_with_what_is_collected(tmp_path, monkeypatch) -> None:
    collected: list[int] = []

    def drive(terrain, seed: int) -> list[Sample]:
        collected.append(seed)
        return made_up(2, seed)

    monkeypatch.setattr(exposure_lessons, "samples", drive)
    lessons = Lessons(scenes=6, held_out=2, seed=10, epochs=3)
    seeds = [seed for group in lessons.seeds for seed in group]
    assert sorted(collect(tmp_path, seeds[:3], jobs=1)) == [10, 11, 12]
    assert sorted(collect(tmp_path, seeds, jobs=1)) == list(range(10, 18))
    assert sorted(collected) == list(range(10, 18))  # none of them twice
    outcomes = list(learn(tmp_path, lessons))
    assert len(outcomes) == 3 and any(better for _, better in outcomes)
    network, _ = load_network(tmp_path / WEIGHTS)
    best = min(now.brier for now, better in outcomes if better)
    assert score(network, read(tmp_path, lessons.seeds[1])).brier == pytest.approx(best, rel=1e-5)
    assert json.loads((tmp_path / CARD).read_text())["validation"]["brier"] == best
