"""GA-Nav's network, how it is taught, scored and kept."""

import json

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from planner.checkpoint import PolicyError, write_tensors
from planner.ga_nav import lessons
from planner.ga_nav.groups import GROUPS, IGNORED
from planner.ga_nav.images import Sample
from planner.ga_nav.learning import Course, Images, attention_loss, confusion, fit, from_confusion, score
from planner.ga_nav.lessons import CARD, WEIGHTS, Lessons, collect, learn, lessons_split
from planner.ga_nav.network import (
    EfficientAttention,
    GaNav,
    GroupAttention,
    Shape,
    load_network,
    save_network,
    segment,
)
from scenes.scenario import ScenarioError

SMALL = Shape(widths=(8, 8, 16, 16), heads=(1, 1, 2, 2), layers=1, decoder=12, detail=4)
HUES = np.array([(30, 60, 200), (220, 220, 220), (60, 160, 40), (150, 100, 50), (20, 20, 90), (160, 20, 90)])


def small(seed: int = 0) -> GaNav:
    torch.manual_seed(seed)
    return GaNav(SMALL).eval()


def made_up(count: int, seed: int, size: tuple[int, int] = (32, 48)) -> Images:
    """Images of two halves, each of a group that has a colour of its own."""
    rng = np.random.default_rng(seed)
    groups = np.zeros((count, *size), np.uint8)
    for image in groups:
        image[:, : size[1] // 2], image[:, size[1] // 2 :] = rng.integers(len(GROUPS), size=2)
    noise = rng.integers(-12, 13, (*groups.shape, 3))
    return Images(np.clip(HUES[groups] + noise, 0, 255).astype(np.uint8), groups)


def test_it_tells_every_pixel_a_group_and_every_group_where_to_look() -> None:
    logits, attention = GaNav().maps(torch.rand(2, 3, 120, 160))
    assert logits.shape == (2, 6, 120, 160) and attention.shape == (2, 6, 8, 10)


def test_it_takes_images_of_any_size_that_it_can_divide() -> None:
    assert small()(torch.rand(1, 3, 96, 128)).shape == (1, 6, 96, 128)


def test_attention_whose_keys_are_not_merged_is_plain_attention() -> None:
    torch.manual_seed(0)
    layer, tokens = EfficientAttention(8, 2, 1), torch.rand(1, 12, 8)
    query, (key, value) = layer.query(tokens), layer.pair(tokens).chunk(2, -1)
    parts = []
    for head in range(2):
        own = slice(4 * head, 4 * head + 4)
        scores = query[..., own] @ key[..., own].transpose(1, 2) / 2.0
        parts.append(scores.softmax(-1) @ value[..., own])
    torch.testing.assert_close(layer(tokens, 3, 4), layer.project(torch.cat(parts, -1)))


def test_merging_keys_keeps_the_number_of_tokens() -> None:
    assert EfficientAttention(8, 2, 4)(torch.rand(2, 48, 8), 6, 8).shape == (2, 48, 8)


def test_a_groups_map_is_the_diagonal_of_its_heads_attention() -> None:
    torch.manual_seed(0)
    layer, image = GroupAttention(12), torch.rand(1, 12, 3, 4)
    query, key, _ = layer.triple(image.flatten(2).transpose(1, 2)).chunk(3, -1)
    _, maps = layer(image)
    for group in range(6):
        own = slice(2 * group, 2 * group + 2)
        whole = query[0, :, own] @ key[0, :, own].T / 2.0**0.5
        torch.testing.assert_close(maps[0, group].flatten(), whole.diagonal())


def test_the_attention_loss_is_least_where_each_map_marks_its_group() -> None:
    groups = torch.zeros(1, 8, 8, dtype=torch.long)
    groups[:, :, 4:] = 3
    right = F.one_hot(groups[:, ::2, ::2], 6).permute(0, 3, 1, 2) * 20.0 - 10.0
    assert attention_loss(right, groups) < 1e-3 < attention_loss(-right, groups)
    unknown = groups.clone()
    unknown[:, :, 4:] = IGNORED
    wrong_there = right.clone()
    wrong_there[:, :, :, 2:] *= -1.0
    assert attention_loss(wrong_there, unknown) < 1e-3


def test_segmenting_halves_the_image_by_averaging() -> None:
    network, rgb = small(), np.random.default_rng(0).integers(0, 256, (64, 96, 3), np.uint8)
    groups, sure = segment(network, rgb)
    half = rgb.reshape(32, 2, 48, 2, 3).astype(np.float32).mean(axis=(1, 3)) / 255.0
    with torch.inference_mode():
        chance = network(torch.from_numpy(half).permute(2, 0, 1)[None]).softmax(1)[0].numpy()
    np.testing.assert_allclose(sure, chance.max(0), atol=1e-5)
    assert groups.dtype == np.uint8 and np.mean(groups == chance.argmax(0)) > 0.999


def test_the_score_is_intersection_over_union() -> None:
    table = np.zeros((6, 6), int)
    table[0, 0], table[0, 2], table[2, 2] = 6, 2, 4
    result = from_confusion(table)
    assert result.iou == (6 / 8, None, 4 / 6, None, None, None)
    assert result.mean_iou == pytest.approx((6 / 8 + 4 / 6) / 2) and result.accuracy == pytest.approx(10 / 12)
    assert result.document()["iou_background"] == 75.0 and result.document()["iou_smooth"] is None


def test_what_is_ignored_is_not_scored() -> None:
    images = made_up(2, 0)
    images.groups[:, 10:, :] = IGNORED
    assert confusion(small(), images).sum() == 2 * 10 * 48


def test_the_same_seed_learns_the_same() -> None:
    course = Course(2, 3, batch=4, crop=(32, 40))
    runs = [[s.mean_iou for s in fit(small(), made_up(8, 1), made_up(4, 2), course)] for _ in range(2)]
    assert runs[0] == runs[1]


def test_learning_makes_it_better_on_what_it_has_not_seen() -> None:
    held_out, course = made_up(16, 2), Course(8, 3, rate=1e-2, batch=4, crop=(32, 40))
    before = score(small(), held_out).mean_iou
    *_, after = fit(small(), made_up(40, 1), held_out, course)
    assert after.mean_iou > before + 0.3


def test_weights_come_back_as_they_were_saved(tmp_path) -> None:
    network, image = small(3), torch.rand(1, 3, 32, 32)
    named = save_network(tmp_path / "w.safetensors", network)
    again, name = load_network(tmp_path / "w.safetensors")
    assert name == named and again.shape == network.shape and not again.training
    torch.testing.assert_close(again(image), network(image), rtol=0.0, atol=0.0)


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
    write_tensors(path, {"a": np.zeros(3, np.float32)}, {"architecture": "ga_nav", "shape": "{}"})
    with pytest.raises(PolicyError, match="shape"):
        load_network(path)


def test_a_training_keeps_its_best_weights_and_goes_on_with_what_is_rendered(tmp_path, monkeypatch) -> None:
    rendered: list[int] = []

    def render(terrain, seed: int) -> list[Sample]:
        rendered.append(seed)
        if seed == 11:
            raise ScenarioError("no scene")
        images = made_up(2, seed)
        return [Sample(rgb, groups) for rgb, groups in zip(images.rgb, images.groups, strict=True)]

    monkeypatch.setattr(lessons, "samples", render)
    monkeypatch.setattr(lessons, "GaNav", lambda: GaNav(SMALL))
    few = Lessons(scenes=6, held_out=2, seed=10, epochs=3)
    seeds = [seed for group in few.seeds for seed in group]
    assert seeds == list(range(10, 20))
    assert sorted(collect(tmp_path, seeds[:3], jobs=1)) == [10, 11, 12]
    assert sorted(collect(tmp_path, seeds, jobs=1)) == seeds
    assert sorted(rendered) == seeds  # none of them twice
    split = lessons_split(tmp_path, few)
    assert [len(part) for part in (split.given, split.validation, split.test)] == [10, 4, 4]
    outcomes = list(learn(tmp_path, split, Course(3, few.seed, crop=(32, 40)), few.about))
    assert len(outcomes) == 3 and outcomes[0][1]
    network, name = load_network(tmp_path / WEIGHTS)
    card = json.loads((tmp_path / CARD).read_text())
    best = max((now for now, better in outcomes if better), key=lambda now: now.mean_iou)
    assert card["sha256"] == name.sha256
    assert card["command"] == ("covernav train --learner ga_nav --scenes 6 --held-out 2 --seed 10 --epochs 3")
    assert card["figures"]["validation"]["miou"] == pytest.approx(100.0 * best.mean_iou, abs=0.006)
    assert card["figures"]["test"] == score(network, split.test).document() | {"images": 4}
