"""Curves over seeds: means by blocks of ten episodes, with Student's interval over the seeds."""

import json

import numpy as np
import pytest
from scipy import stats

from planner.learning_errors import TrainingRefusal
from planner.training_curves import curve, summarise


def test_a_block_is_the_mean_of_ten_episodes():
    found = curve([np.repeat([1.0, 3.0], 10), np.repeat([2.0, 3.0], 10), np.repeat([3.0, 3.0], 10)])
    assert found.mean == (2.0, 3.0)
    half = stats.t.ppf(0.975, 2) * 1.0 / np.sqrt(3)
    assert found.low[0] == pytest.approx(2.0 - half, abs=1e-3) and found.high[1] == 3.0


def test_one_seed_has_no_interval_and_half_a_block_no_point():
    found = curve([np.arange(15.0)])
    assert found.mean == found.low == found.high == (4.5,)


def test_the_interval_of_a_share_stays_a_share():
    seeds = [np.zeros(10), np.zeros(10), np.repeat([0.0, 1.0], 5)]
    free, share = curve(seeds), curve(seeds, 0.0, 1.0)
    assert free.low[0] < 0.0 and share.low == (0.0,)
    assert share.mean == free.mean and share.high == free.high


def run(folder, seed, reward, count=10):
    folder.mkdir()
    (folder / "settings.json").write_text(json.dumps({"seed": seed, "options": {"reward": reward}}))
    row = {"total": float(seed), "success": True, "final": "reached", "exposed_s": 1.0, "steps": 7}
    row["terms"] = {"g": 2.0}
    (folder / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for _ in range(count)))
    return folder


def test_trainings_that_differ_in_the_seed_alone_are_taken_together(tmp_path):
    folders = [run(tmp_path / f"{r}{s}", s, r) for r in ("paper", "corrected") for s in (1, 0)]
    document = summarise(folders)
    assert [group["options"]["reward"] for group in document["groups"]] == ["paper", "corrected"]
    assert document["groups"][0]["seeds"] == [0, 1] and document["groups"][0]["steps"] == [70, 70]
    assert document["groups"][0]["curves"]["return"]["mean"] == (0.5,)
    assert document["groups"][0]["curves"]["terms/g"]["mean"] == (2.0,)


def test_curves_are_of_what_the_policy_drove(tmp_path):
    folder = run(tmp_path / "shown", 3, "paper", count=20)
    rows = [json.loads(line) for line in (folder / "episodes.jsonl").read_text().splitlines()]
    for row in rows[1::2]:
        row |= {"demonstrated": True, "total": 1e3}
    (folder / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    (group,) = summarise([folder])["groups"]
    assert group["episodes"] == 10 and group["curves"]["return"]["mean"] == (3.0,)


def test_a_folder_without_a_training_is_refused(tmp_path):
    with pytest.raises(TrainingRefusal, match="holds no training to summarise"):
        summarise([tmp_path])
