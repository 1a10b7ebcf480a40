"""The evaluation that is shipped: the README says what is in it, and it was driven by what is shipped."""

import hashlib
import json
import sqlite3
import zlib
from contextlib import closing
from pathlib import Path

import pytest

from app.results import SAMPLE, Evaluation
from planner.methods import POLICIES

SUMMARIES = "SELECT summary FROM missions"
README = Path(__file__).parents[2] / "README.md"


@pytest.fixture(scope="module")
def sample() -> Evaluation:
    return Evaluation(SAMPLE)


def test_the_readmes_table_is_the_samples(sample):
    lines = README.read_text("utf-8").splitlines()
    for row in sample.rows:
        begin = f"| {row['terrain']} | `{row['method']}` | "
        (line,) = [line for line in lines if line.startswith(begin)]
        n, success, _, exposed, removed, *_ = (cell.strip() for cell in line.split("|")[3:])
        assert int(n) == row["missions"]
        assert success.split()[0] == f"{100.0 * row['success_rate']:.0f}"
        assert exposed.split()[0] == f"{row['exposed_s']:.1f}"
        assert removed.split()[0] == f"{100.0 * row['avoidable_removed']:.0f}"


def test_its_learned_methods_drove_with_the_weights_that_are_shipped():
    with closing(sqlite3.connect(f"{SAMPLE.as_uri()}?mode=ro", uri=True)) as database:
        missions = [json.loads(zlib.decompress(row)) for (row,) in database.execute(SUMMARIES)]
    weights = POLICIES.glob("*.safetensors")
    shipped = {path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in weights}
    drove = {(m["policy"]["name"], m["policy"]["sha256"]) for m in missions if m.get("policy")}
    assert {name for name, _ in drove} >= {"covernav", "covernav_paper", "ga_nav", "terp"}
    assert all(shipped[name] == digest for name, digest in drove)
