"""`covernav train`: what it leaves, how it goes on, and what it refuses."""

import json

import pytest

from app import train_command
from app.cli import main
from planner.reward import REWARDS

SMALL = ["--episodes", "1", "--steps", "3", "--terrain", "low"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("train") / "here"
    assert main(["train", *SMALL, "--seed", "4", "--reward", "paper", "--out", str(folder)]) == 0
    return folder


def test_it_leaves_a_policy_a_log_and_its_settings(trained):
    settings = json.loads((trained / "settings.json").read_text())
    assert (settings["episodes"], settings["steps"], settings["seed"]) == (1, 3, 4)
    assert settings["options"] == {"reward": "paper", "dynamics": "kinematic"}
    assert settings["ddpg"]["critic_rate"] == 1e-4
    (row,) = [json.loads(line) for line in (trained / "episodes.jsonl").read_text().splitlines()]
    assert {"goal", "dir", "stab", "elev", "cover"} <= set(row["terms"])
    assert (trained / "policy.safetensors").is_file()


def test_it_goes_on_for_more_episodes(trained, capsys):
    assert main(["train", "--resume", str(trained), "--episodes", "2"]) == 0
    assert "2 of 2 episodes" in capsys.readouterr().out
    assert len((trained / "episodes.jsonl").read_text().splitlines()) == 2


def test_nothing_but_the_result_is_printed_without_a_terminal(trained, capfd):
    assert main(["train", "--resume", str(trained)]) == 0
    printed = capfd.readouterr()
    assert printed.out.count("\n") == 1 and printed.err == ""


def test_trainings_are_summarised_as_one_document(trained, capsys):
    assert main(["train", "--curves", str(trained)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["groups"][0]["seeds"] == [4]


def test_learning_curves_are_drawn_and_the_same_again(trained, tmp_path, capsys):
    figures = tmp_path / "one.svg", tmp_path / "two.svg"
    for figure in figures:
        assert main(["train", "--curves", str(trained), str(trained), "--figure", str(figure)]) == 0
    assert figures[0].read_bytes() == figures[1].read_bytes() and b"<svg" in figures[0].read_bytes()
    capsys.readouterr()
    assert main(["train", "--curves", str(trained), "--figure", str(tmp_path / "curves.gif")]) == 2
    assert "must end in .png or .svg" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--resume", "{trained}", "--seed", "1"], "--seed is settled by the training that goes on"),
        (["--resume", "{trained}", "--demonstrations", "9"], "--demonstrations is settled by the training"),
        (["--resume", "{trained}", "--curriculum"], "--curriculum is settled"),
        (["--resume", "{trained}", "--episodes", "1"], "was begun for 2 episodes, not 1"),
        (["--resume", "{trained}/replay"], "holds no training to go on with"),
        (["--out", "{trained}"], "holds a training already"),
        (["--out", "{trained}/replay"], "is not empty"),
        (["--out", "{trained}/settings.json"], "cannot be written"),
        (["--out", "/proc/nowhere"], "cannot be written"),
        (["--curves", "{trained}", "--figure", "/proc/nowhere.png"], "cannot be written"),
        (["--figure", "curves.png"], "name the trainings with --curves"),
        (["--json", "-"], "--curves and --validate"),
        (["--missions", "3"], "name the trainings with it"),
        (["--curves", "{trained}", "--learner", "habits"], "leave --learner habits out"),
        (["--resume", "{trained}", "--learner", "terp"], "leave --learner terp out"),
        (["--curriculum", "--learner", "terp"], "leave one out"),
        (["--curriculum", "--steps", "30"], "leave --steps out"),
        (["--curriculum", "--terrain", "low"], "leave --terrain out"),
        (["--learner", "habits", "--out", "{trained}/settings.json"], "cannot be written"),
        (["--learner", "exposure", "--out", "/proc/nowhere"], "cannot be written"),
        (["--learner", "habits", "--out", "{trained}"], "is not empty"),
        (["--learner", "habits", "--reward", "paper"], "--reward is nothing to --learner habits"),
        (["--scenes", "5"], "--scenes is nothing to --learner paper"),
        (["--curves", "{trained}", "--seed", "0"], "--seed is nothing to --curves"),
    ],
)
def test_what_cannot_be_met_is_refused_in_one_line(trained, capsys, arguments, words):
    assert main(["train", *(argument.format(trained=trained) for argument in arguments)]) == 2
    message = capsys.readouterr().err
    assert words in message and message.count("\n") == 1


NONSENSE = [["--reward", "nice"], ["--episodes", "0"], ["--out", "a", "--resume", "b"]]


@pytest.mark.parametrize("arguments", NONSENSE)
def test_arguments_that_make_no_sense_are_refused(arguments):
    with pytest.raises(SystemExit) as ended:
        main(["train", *arguments])
    assert ended.value.code == 2


def test_a_failure_on_the_way_is_ours(tmp_path, capsys, monkeypatch):
    from planner import training_store

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(training_store, "write_tensors", full)
    assert main(["train", *SMALL, "--out", str(tmp_path / "t")]) == 1
    message = capsys.readouterr().err
    assert "No space left on device; the last checkpoint there is whole" in message
    assert message.count("\n") == 1


def test_the_rewards_are_those_of_the_environment():
    assert set(train_command.REWARDS) == set(REWARDS)
