"""The command line: exit statuses, one line for a refusal, and nothing but the document on --json -."""

import json
from pathlib import Path

import pytest

from app.cli import main
from app.store import FRAME_COLUMNS
from scenes.library import shipped
from scenes.scenario import Scenario

RUN_KEYS = {
    "scenario", "method", "perception", "seed", "status", "success", "trajectory_length_m", "straight_line_m",
    "execution_time_s", "exposure_fraction", "exposed_s", "longest_exposure_s", "detection_probability",
    "cover_fraction", "collisions", "max_roll_deg", "max_pitch_deg", "planner_ms_p50", "planner_ms_p95",
    "policy", "motion_policy", "expected_detection_s", "concealed_fraction", "by_observer",
    "elevation_gradient_m", "dynamic_violations", "motion", "timeline",
}  # fmt: skip


@pytest.fixture
def meadow_file(tmp_path: Path, meadow) -> str:
    path = tmp_path / "meadow.json"
    meadow.save(path)
    return str(path)


def refused(capsys, *argv: str) -> str:
    """Run a command that must be refused; returns its one line."""
    try:
        status = main(argv)
    except SystemExit as exit:
        status = exit.code
    captured = capsys.readouterr()
    assert status == 2 and captured.out == ""
    (line,) = captured.err.strip().splitlines()
    return line


def test_run_prints_one_json_document_and_nothing_else(capsys, meadow_file):
    assert main(["run", meadow_file, "--perception", "oracle", "--json", "-"]) == 0
    captured = capsys.readouterr()
    summary = json.loads(captured.out)
    assert set(summary) == RUN_KEYS and captured.err == ""
    assert summary["status"] == "reached" and summary["success"] is True
    (watcher,) = summary["by_observer"]
    assert watcher["observer_id"] == 1 and watcher["exposed_s"] == summary["exposed_s"] > 0.0
    timeline = summary["timeline"]
    assert 0.1 * sum(timeline["exposure"]) == pytest.approx(summary["exposed_s"], abs=0.01)
    assert timeline["detection_probability"][-1] == pytest.approx(summary["detection_probability"], abs=1e-5)
    assert timeline["time_s"][-1] == pytest.approx(summary["execution_time_s"])


def test_run_takes_another_goal_and_a_time_limit(capsys, meadow_file):
    arguments = ["--goal", "-3", "4", "--time-limit", "0.5", "--perception", "oracle", "--json", "-"]
    assert main(["run", meadow_file, *arguments]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["status"] == "timeout" and summary["straight_line_m"] == pytest.approx(4.0)


def test_a_recorded_run_leaves_scenario_summary_and_every_tick(capsys, tmp_path, meadow_file):
    folder = tmp_path / "run"
    arguments = ["--perception", "oracle", "--time-limit", "1", "--record", str(folder)]
    assert main(["run", meadow_file, *arguments]) == 0
    assert Scenario.load(folder / "scenario.json").to_json() == Scenario.load(meadow_file).to_json()
    assert json.loads((folder / "summary.json").read_text())["status"] == "timeout"
    lines = (folder / "frames.csv").read_text().splitlines()
    assert lines[0] == ",".join((*FRAME_COLUMNS, "status")) and len(lines) >= 10


@pytest.mark.parametrize(
    ("argv", "reason"),
    [
        (["run", "no-such-place"], "neither a shipped scenario nor a file"),
        (["run", "no-such-file.json"], "no-such-file.json"),
        (["run", "MEADOW", "--method", "teleport"], "no method 'teleport'"),
        (["run", "MEADOW", "--goal", "500", "0"], "goal is off the map"),
        (["run", "MEADOW", "--goal", "nan", "0"], "--goal"),
        (["run", "MEADOW", "--goal", "0", "5"], "goal is inside a tree"),
        (["run", "MEADOW", "--seed", "-1"], "--seed"),
        (["run", "MEADOW", "--time-limit", "0"], "--time-limit"),
        (["run", "MEADOW", "--perception", "magic"], "--perception"),
        (["run", "MEADOW", "--time-limit", "0.2", "--json", "/proc/nowhere/x.json"], "cannot be written"),
        (["evaluate", "--methods", "teleport"], "no method 'teleport'"),
        (["evaluate", "--terrains", "moon"], "no terrain 'moon'"),
        (["evaluate", "--missions", "0"], "--missions"),
        (["evaluate", "--missions", "1", "--out", "/proc/nowhere"], "cannot be written"),
        (["scenarios", "show", "no-such-place"], "neither"),
        (["scenarios", "generate", "moon", "--seed", "1", "-o", "x.json"], "moon"),
        (["scenarios", "generate", "normal", "--seed", "1", "-o", "/proc/x.json"], "cannot be written"),
        (["scenarios", "import", "no-such-file.laz", "-o", "x.json"], "no-such-file.laz"),
        (["bench", "--only", "nothing"], "no bench 'nothing'"),
        (["fly"], "fly"),
    ],
)
def test_a_request_that_cannot_be_met_is_status_2_and_one_line(capsys, meadow_file, argv, reason):
    argv = [meadow_file if word == "MEADOW" else word for word in argv]
    assert reason in refused(capsys, *argv)


def test_list_names_every_shipped_scenario(capsys):
    assert main(["scenarios", "list"]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert listed == list(shipped())


def test_show_gives_the_document_itself_on_request(capsys):
    name = next(iter(shipped()))
    assert main(["scenarios", "show", name, "--json", "-"]) == 0
    assert capsys.readouterr().out == shipped()[name].read_text("utf-8")


def test_generate_gives_the_same_file_for_the_same_seed(capsys, tmp_path):
    for name in ("a", "b"):
        file = str(tmp_path / f"{name}.json")
        assert main(["scenarios", "generate", "low", "--seed", "7", "-o", file]) == 0
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_an_interrupted_evaluation_goes_on_to_the_same_table(capsys, tmp_path):
    command = ["evaluate", "--methods", "dwa", "--terrains", "normal", "--missions", "2", "--jobs", "1"]
    command += ["--perception", "oracle", "--goal-distance", "5", "--json", "-", "--out", str(tmp_path)]
    assert main(command) == 0
    whole = json.loads(capsys.readouterr().out)
    journal = tmp_path / "missions.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text(lines[0] + lines[1][:20])
    assert main(command) == 0
    again = json.loads(capsys.readouterr().out)
    for document in (whole, again):
        for entry in (*document["rows"], *document["missions"]):
            for key in ("planner_ms_p50", "planner_ms_p95"):
                entry.pop(key, None)
    assert whole == again
