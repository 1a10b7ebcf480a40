"""`covernav evaluate`: a refusal is one line and status 2; groups of methods; tables in the folder."""

import importlib
import json
import signal
import subprocess
import sys
import time

import pytest
from evaluations import drive

from app import evaluate_command
from app.cli import main
from app.results_store import ResultsFile
from planner import evaluation, methods
from planner.methods import METHODS, MethodEntry

QUICK = ["evaluate", "--methods", "dwa,least_cost", "--terrains", "normal", "--missions", "2", "--jobs", "1"]


@pytest.fixture
def undriven(monkeypatch):
    """Nobody really drives."""
    monkeypatch.setattr(
        evaluation, "drive", lambda spec: drive(spec.seed, spec.method, suite="random", goal_distance=12.0)
    )


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--methods", "teleport"], "no method 'teleport'"),
        (["--methods", ","], "--methods names none"),
        (["--methods", "dwa@whatever"], "takes no weights"),
        (["--methods", "covernav_paper@nowhere.safetensors"], "nowhere.safetensors"),
        (["--terrains", "normal,moon"], "no terrain 'moon'"),
        (["--terrains", " , "], "--terrains names none"),
        (["--seed", str(2**63 - 1), "--missions", "2"], "lower --seed"),
        (["--json", "/proc/nowhere/table.json"], "/proc/nowhere/table.json cannot be written"),
        (["--json", "/tmp"], "it is a folder"),
        (["--methods", "dwa", "--against", "covernav"], "add it to --methods"),
        (["--methods", "dwa", "--cluster", "auto"], "pip install '.[cluster]'"),
    ],
)
def test_what_cannot_be_asked_is_one_line(capsys, monkeypatch, options, reason):
    def no_ray(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", no_ray)
    assert main(["evaluate", "--missions", "1", *options]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and reason in captured.err and captured.err.count("\n") == 1


def test_a_folder_of_something_else_is_left_alone(capsys, tmp_path):
    (tmp_path / "letters.txt").write_text("dear reader")
    assert main([*QUICK, "--out", str(tmp_path)]) == 2
    assert "holds no evaluation" in capsys.readouterr().err
    assert [entry.name for entry in tmp_path.iterdir()] == ["letters.txt"]


def test_the_folder_holds_the_tables_and_the_file_for_the_browser(capsys, tmp_path, undriven):
    out = tmp_path / "lanes"
    assert main([*QUICK, "--out", str(out), "--against", "dwa"]) == 0
    text = capsys.readouterr().out
    assert "[72]" in text and "*bound*" in text and "`least_cost` | `dwa`" in text
    assert {entry.name for entry in out.iterdir()} == {
        *("missions.jsonl", "table.json", "table.csv", "results.sqlite"),
    }
    table = json.loads((out / "table.json").read_text())
    assert [row["method"] for row in table["rows"]] == ["dwa", "least_cost"]
    file = ResultsFile(out / "results.sqlite")
    assert file.title == "lanes" and len(file.missions()) == 4


def test_the_document_has_rows_bound_pairs_missions_and_versions(capsys, undriven):
    assert main([*QUICK, "--json", "-"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(document) == ["rows", "bounds", "totals", "total_bounds", "paired", "versions", "missions"]
    assert len(document["missions"]) == 4 and document["paired"][0]["against"] == "dwa"


def test_an_evaluation_in_which_nothing_could_be_driven_fails(capsys, monkeypatch):
    def broken(spec):
        raise RuntimeError("no wheels")

    monkeypatch.setattr(evaluation, "drive", broken)
    assert main(QUICK) == 1
    assert "RuntimeError: no wheels" in capsys.readouterr().err


def test_groups_of_methods(monkeypatch):
    entry = MethodEntry(METHODS["dwa"].make, "the plain window once more")
    monkeypatch.setattr(methods, "VARIANTS", {"covernav[no_cover]": entry})
    assert evaluate_command._methods("ablations") == ["covernav", "covernav[no_cover]"]
    assert evaluate_command._methods("dwa,ablations,dwa") == ["dwa", "covernav", "covernav[no_cover]"]
    assert set(evaluate_command._methods("all")) == {name for name in methods.COMPARED if name in METHODS}


def test_terrains_may_be_named_with_blanks_between(capsys, undriven):
    options = ["--methods", "dwa", "--terrains", "normal, forest,", "--missions", "1", "--jobs", "1"]
    assert main(["evaluate", *options, "--json", "-"]) == 0
    assert len(json.loads(capsys.readouterr().out)["missions"]) == 2


def test_the_same_command_goes_on_and_says_which_code_drove(capsys, tmp_path, undriven):
    out = tmp_path / "lanes"
    assert main([*QUICK, "--out", str(out)]) == 0
    first = capsys.readouterr()
    assert main([*QUICK, "--out", str(out)]) == 0
    again = capsys.readouterr()
    assert again.out == first.out
    assert "4 of the missions" in again.err and "other code" in again.err, "these drives do not say"


def test_drives_with_other_weights_are_not_mixed_in(capsys, tmp_path, undriven):
    wanted = ["evaluate", "--methods", "terp", "--terrains", "normal", "--missions", "1", "--jobs", "1"]
    assert main([*wanted, "--out", str(tmp_path / "lanes")]) == 0
    capsys.readouterr()
    assert main([*wanted, "--out", str(tmp_path / "lanes")]) == 2
    assert "drives of terp with other weights" in capsys.readouterr().err


REAL = [
    "evaluate", "--methods", "dwa", "--terrains", "normal", "--perception", "oracle", "--goal-distance", "4",
]  # fmt: skip


def test_one_process_and_two_make_the_same_table_of_real_drives(tmp_path):
    tables = []
    for jobs in ("1", "2"):
        out = tmp_path / jobs
        assert main([*REAL, "--missions", "2", "--jobs", jobs, "--out", str(out)]) == 0
        table = json.loads((out / "table.json").read_text())
        for row in table["rows"]:
            del row["planner_ms_p50"]
        tables.append(json.dumps(table))
    assert tables[0] == tables[1]


def test_interrupted_it_finishes_what_is_under_way_and_the_same_command_goes_on(tmp_path):
    out = tmp_path / "lanes"
    command = [sys.executable, "-m", "app.cli", *REAL, "--missions", "4", "--jobs", "1", "--out", str(out)]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    journal = out / "missions.jsonl"
    while running.poll() is None and not (journal.exists() and journal.read_bytes().count(b"\n")):
        time.sleep(0.02)
    running.send_signal(signal.SIGINT)
    _, words = running.communicate()
    assert running.returncode == 130 and "finishing the missions under way" in words
    kept = journal.read_bytes()
    assert 1 <= kept.count(b"\n") < 4 and kept.endswith(b"\n")
    assert main([*REAL, "--missions", "4", "--jobs", "1", "--out", str(out)]) == 0
    assert journal.read_bytes().startswith(kept) and journal.read_bytes().count(b"\n") == 4
