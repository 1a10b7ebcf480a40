"""The trainer: the same numbers however it is run, interrupted or not, and nothing finished is lost."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_training import TOY, left, settings, train

from planner.checkpoint import load_policy, read_tensors, weights
from planner.curriculum import Curriculum, Promotion, Stage
from planner.learning_errors import TrainingError, TrainingRefusal
from planner.networks import PAPER, Actor
from planner.observation import LAYERS
from planner.training import Trainer
from planner.training_collector import Collector, CollectorProcess, EpisodeOrder, StepFrame
from planner.training_control import Control
from planner.training_events import EpisodeDone, Stopped
from planner.training_settings import ENVIRONMENT
from scenes.scenario import Family


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A training that nothing interrupted."""
    folder = tmp_path_factory.mktemp("whole") / "training"
    return folder, train(folder, settings())


def test_an_episode_an_event_and_a_line(whole):
    folder, events = whole
    episodes = [event for event in events if isinstance(event, EpisodeDone)]
    assert [event.number for event in episodes] == [0, 1, 2, 3]
    assert events[-1] == Stopped(4, complete=True)
    rows = [json.loads(line) for line in (folder / "episodes.jsonl").read_text().splitlines()]
    assert [row["number"] for row in rows] == [0, 1, 2, 3]
    assert set(rows[0]) == {
        "number", "steps", "total", "terms", "success", "exposed_s", "final", "losses", "updates", "stage",
        "normalised", "demonstrated",
    }  # fmt: skip
    assert rows[0]["losses"] is None and rows[3]["losses"]["critic"] > 0.0
    assert rows[3]["total"] == pytest.approx(sum(rows[3]["terms"].values()), rel=1e-6)
    assert len((folder / "pace.jsonl").read_text().splitlines()) == 4
    assert list(folder.glob("events.out.tfevents*"))


def test_the_policy_is_left_ready_to_drive(whole):
    folder, _ = whole
    actor, name = load_policy(folder / "policy.safetensors")
    assert name.name == "policy" and actor.architecture.channels == 1


def test_a_process_for_driving_changes_no_number(whole, tmp_path):
    train(tmp_path / "t", settings(), parallel=True)
    assert left(tmp_path / "t") == left(whole[0])


def test_watching_changes_no_number(whole, tmp_path):
    events = train(tmp_path / "t", settings(), frames_every=5)
    frames = [event for event in events if isinstance(event, StepFrame)]
    assert [(frame.episode, frame.step) for frame in frames[:3]] == [(0, 0), (0, 5), (0, 10)]
    assert frames[0].attention.shape == frames[0].cost.shape == (40, 40)
    assert left(tmp_path / "t") == left(whole[0])


def test_exposure_is_shown_to_those_who_watch_and_changes_no_number(tmp_path):
    """The paper's network does not read it, so that it is reckoned for people only."""
    wanted = settings(episodes=2, steps=4, environment=ENVIRONMENT)
    events = train(tmp_path / "watched", wanted, frames_every=1)
    train(tmp_path / "alone", wanted)
    exposure = LAYERS.index("exposure")
    assert all(event.layers[exposure].any() for event in events if isinstance(event, StepFrame))
    assert left(tmp_path / "alone") == left(tmp_path / "watched")


def test_nobody_waits_with_a_policy_while_the_ground_ahead_is_made(tmp_path):
    """It is larger than what a pipe holds."""
    ready = tmp_path / "ready"
    source = CollectorProcess(Collector(TOY, {"ground_when": str(ready)}, PAPER))
    order = EpisodeOrder(0, 0, 1, None, {}, weights(Actor()), following=(1, {}))
    sending = threading.Thread(target=lambda: source.begin(replace(order, number=1)))
    try:
        source.begin(order)
        while source.poll(1.0) is None:
            pass
        sending.start()
        sending.join(20.0)
        waited = sending.is_alive()
        ready.touch()
        while (collected := source.poll(1.0)) is None:
            pass
        assert not waited and collected.number == 1
    finally:
        source.close()


def test_another_seed_is_another_training(whole, tmp_path):
    train(tmp_path / "t", settings(seed=1))
    assert left(tmp_path / "t") != left(whole[0])


@pytest.mark.parametrize("episodes", [1, 2, 3])
def test_stopped_after_any_episode_it_goes_on_as_if_nothing_had_been(whole, tmp_path, episodes):
    control = Control()
    for event in Trainer(tmp_path / "t", settings(), control=control, parallel=False).run():
        if isinstance(event, EpisodeDone) and event.number == episodes - 1:
            control.stop()
    assert event == Stopped(episodes, complete=False)
    train(tmp_path / "t")
    assert left(tmp_path / "t") == left(whole[0])


@pytest.mark.parametrize("episodes", [1, 2, 3])
def test_a_training_made_longer_ends_as_if_it_had_been_begun_so(whole, tmp_path, episodes):
    train(tmp_path / "t", settings(episodes=episodes))
    longer = Trainer(tmp_path / "t", parallel=False)
    longer.extend(4)
    list(longer.run())
    assert left(tmp_path / "t") == left(whole[0])


def test_killed_in_the_middle_it_goes_on_as_if_nothing_had_been(whole, tmp_path):
    script = (
        "import sys, test_training as t\n"
        "from pathlib import Path\n"
        "if __name__ == '__main__':\n"
        "    trainer = t.Trainer(Path(sys.argv[1]), t.settings(), frames_every=1)\n"
        "    for event in trainer.run():\n"
        "        if isinstance(event, t.StepFrame) and event.episode == 2 and event.step == 4:\n"
        "            print('now', flush=True)\n"
        "            sys.stdin.read()\n"
    )
    (tmp_path / "script.py").write_text(script)
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "script.py"), str(tmp_path / "t")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip
    assert process.stdout.readline() == b"now\n"
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdin.close(), process.stdout.close()
    assert json.loads((tmp_path / "t/checkpoint.json").read_text())["episodes"] == 2
    train(tmp_path / "t")
    assert left(tmp_path / "t") == left(whole[0])


ORPHAN = """
import os, sys, time
from pathlib import Path
import test_training as t
if __name__ == "__main__":
    from planner.training_collector import Collector, CollectorProcess
    trainer = t.Trainer(Path(sys.argv[1]), t.settings(steps=100000), parallel=False)
    settings = trainer.settings
    source = CollectorProcess(Collector(settings.environment, {"max_steps": 100000}, settings.architecture))
    source.begin(trainer._order(0).__class__(**{**trainer._order(0).__dict__, "frames_every": 1}))
    while source.poll(1.0) is None:
        pass
    source.pause()
    print(source._process.pid, flush=True)
    os._exit(0)
"""


def test_who_drives_ends_with_a_training_that_dies_while_it_is_paused(tmp_path):
    (tmp_path / "orphan.py").write_text(ORPHAN)
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    found = subprocess.run(
        [sys.executable, str(tmp_path / "orphan.py"), str(tmp_path / "t")],
        stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": path}, check=True,
    )  # fmt: skip
    driver = Path("/proc") / found.stdout.decode().strip()
    for _ in range(600):
        if not driver.exists() or "Z" in (driver / "stat").read_text().split(")")[1][:3]:
            return
        time.sleep(0.1)
    os.kill(int(driver.name), signal.SIGKILL)
    raise AssertionError("it waits for ever")


STAGES = tuple(Stage(str(far), (Family.NORMAL,), far, nearest=1.0) for far in (1.0, 8.0))
EASY = Promotion(0.5, 2)


@pytest.mark.parametrize("episodes", [2, 3, 4])
def test_a_curriculum_goes_on_where_it_was_over_a_promotion_too(tmp_path, episodes):
    def learn(folder, wanted=None, control=None):
        lessons = Curriculum(settings().seed, STAGES, EASY)
        return Trainer(folder, wanted, parallel=False, curriculum=lessons, control=control)

    whole = learn(tmp_path / "whole", settings(episodes=6))
    list(whole.run())
    assert whole.progress.curriculum["stage"] == 1, "a metre is soon driven"
    rows = [json.loads(line) for line in (tmp_path / "whole/episodes.jsonl").read_text().splitlines()]
    assert rows[0]["stage"] == "1.0" and rows[-1]["stage"] == "8.0"
    control = Control()
    for event in learn(tmp_path / "cut", settings(episodes=6), control).run():
        if isinstance(event, EpisodeDone) and event.number == episodes - 1:
            control.stop()
    list(learn(tmp_path / "cut").run())
    assert left(tmp_path / "cut") == left(tmp_path / "whole")


def test_options_that_a_file_cannot_hold_are_refused(tmp_path):
    with pytest.raises(TrainingRefusal, match="what JSON holds"):
        train(tmp_path / "t", settings(options={"reward_scale": object()}))


def test_a_disk_too_full_for_the_curves_is_said(tmp_path, monkeypatch):
    import torch.utils.tensorboard as board

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(board, "SummaryWriter", full)
    with pytest.raises(TrainingError, match="curves cannot be written: No space left"):
        train(tmp_path / "t", settings())
    monkeypatch.undo()
    assert train(tmp_path / "t")[-1] == Stopped(4, complete=True), "and the folder is free again"


def test_a_line_of_an_episode_that_was_not_finished_is_taken_back(whole, tmp_path):
    control = Control()
    for event in Trainer(tmp_path / "t", settings(), control=control, parallel=False).run():
        if isinstance(event, EpisodeDone) and event.number == 1:
            control.stop()
    with open(tmp_path / "t/episodes.jsonl", "a") as log:
        log.write('{"number": 2, "ste')
    (tmp_path / "t/replay/000002.safetensors").write_bytes(b"half")
    train(tmp_path / "t")
    assert left(tmp_path / "t") == left(whole[0])


def test_paused_it_does_nothing_until_it_goes_on(tmp_path):
    control = Control()
    running = Trainer(tmp_path / "t", settings(), control=control, parallel=False).run()
    assert isinstance(next(running), EpisodeDone)
    control.pause()
    rest = []
    thread = threading.Thread(target=lambda: rest.extend(running))
    thread.start()
    thread.join(0.3)
    assert thread.is_alive() and not rest
    control.resume()
    thread.join(30.0)
    assert rest[-1] == Stopped(4, complete=True)


def test_a_finished_training_has_nothing_to_go_on_with(whole):
    folder, _ = whole
    before = left(folder)
    assert train(folder) == [Stopped(4, complete=True)]
    assert left(folder) == before


def test_two_trainings_in_one_folder_are_refused(tmp_path):
    running = Trainer(tmp_path / "t", settings(), parallel=False).run()
    next(running)
    with pytest.raises(TrainingRefusal, match=f"process {os.getpid()} trains in"):
        Trainer(tmp_path / "t")
    running.close()
    Trainer(tmp_path / "t").run().close()


def test_a_folder_that_holds_something_is_refused(whole, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(TrainingRefusal, match=r"not empty \(it has 'notes.txt'\)"):
        Trainer(tmp_path, settings())
    assert [found.name for found in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(TrainingRefusal, match="holds a training already"):
        Trainer(whole[0], settings())
    with pytest.raises(TrainingRefusal, match="holds no training to go on with"):
        Trainer(tmp_path)


def test_a_file_in_the_folders_place_is_refused(tmp_path):
    (tmp_path / "t").write_text("a file")
    with pytest.raises(TrainingRefusal, match="cannot be written"):
        Trainer(tmp_path / "t", settings())


def test_a_damaged_checkpoint_is_refused(tmp_path):
    control = Control()
    for _ in Trainer(tmp_path / "t", settings(), control=control, parallel=False).run():
        control.stop()
    path = next((tmp_path / "t").glob("learner-*"))
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(TrainingRefusal, match=r"cannot go on: .* truncated"):
        Trainer(tmp_path / "t")


def test_a_reward_that_is_no_number_stops_it_and_is_named(tmp_path):
    wanted = settings(options={"broken_after": 30})
    with pytest.raises(TrainingError, match=r"term 'cover' became nan .* checkpoint after episode 2 is kept"):
        train(tmp_path / "t", wanted)
    assert json.loads((tmp_path / "t/checkpoint.json").read_text())["episodes"] == 2


def test_a_loss_that_is_no_number_stops_it_and_is_named(tmp_path):
    wanted = settings(options={"reward_scale": 1e30})
    with pytest.raises(TrainingError, match=r"the critic loss became inf; the checkpoint after episode 2"):
        train(tmp_path / "t", wanted)
    tensors, _, _ = read_tensors(tmp_path / "t/learner-000002.safetensors")
    assert all(np.isfinite(tensor).all() for tensor in tensors.values())


def test_a_full_disk_is_said_and_the_last_checkpoint_stays(tmp_path, monkeypatch):
    from planner import training_store

    write = training_store.write_tensors

    def full(path, *rest):
        if path.name == "learner-000003.safetensors":
            raise OSError(28, "No space left on device")
        return write(path, *rest)

    monkeypatch.setattr(training_store, "write_tensors", full)
    with pytest.raises(TrainingError, match="No space left on device; the last checkpoint there is whole"):
        train(tmp_path / "t", settings())
    monkeypatch.undo()
    assert json.loads((tmp_path / "t/checkpoint.json").read_text())["episodes"] == 2
    assert train(tmp_path / "t")[-1] == Stopped(4, complete=True)


def test_an_environment_that_refuses_is_quoted(tmp_path):
    with pytest.raises(TrainingError, match=r"ToyDrive-v0 cannot be made: .*unknown_option"):
        train(tmp_path / "t", settings(options={"unknown_option": 1}), parallel=True)
