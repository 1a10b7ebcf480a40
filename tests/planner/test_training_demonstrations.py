"""Episodes that a planner drives for the learner to learn from."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_training import left, settings, train

from planner.curriculum import Curriculum, Promotion, Stage
from planner.learning_errors import TrainingError
from planner.training import Trainer
from planner.training_control import Control
from planner.training_events import EpisodeDone
from planner.training_settings import ENVIRONMENT, TrainingSettings
from scenes.scenario import Family

NEAR = {"terrain": "normal", "goal_distance": 4.0}
SHOWN = settings(environment=ENVIRONMENT, steps=100, demonstrations=50, resets=(NEAR,))


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A training whose every other episode a planner drives."""
    folder = tmp_path_factory.mktemp("shown") / "training"
    train(folder, SHOWN)
    return folder


def test_a_planner_drives_its_share_of_the_episodes_and_arrives(shown):
    rows = [json.loads(line) for line in (shown / "episodes.jsonl").read_text().splitlines()]
    assert [row["demonstrated"] for row in rows] == [False, True, False, True]
    assert all(row["success"] for row in rows if row["demonstrated"])


def test_demonstrations_are_the_same_after_an_interruption(shown, tmp_path):
    control = Control()
    for event in Trainer(tmp_path / "t", SHOWN, control=control, parallel=False).run():
        if isinstance(event, EpisodeDone) and event.number == 1:
            control.stop()
    train(tmp_path / "t")
    assert left(tmp_path / "t") == left(shown)


@given(percent=st.integers(0, 99), episodes=st.integers(1, 300))
def test_demonstrations_lie_evenly_among_the_episodes(percent, episodes):
    wanted = settings(demonstrations=percent)
    assert sum(map(wanted.demonstrated, range(episodes))) == episodes * percent // 100


@pytest.mark.parametrize("percent", [-1, 100])
def test_something_is_left_to_the_policy(percent):
    with pytest.raises(ValueError, match="0 to 99 per cent"):
        settings(demonstrations=percent)


def test_what_an_earlier_version_settled_for_can_be_read():
    document = settings().document() | {"demonstration_share": 0.5}
    del document["demonstrations"]
    assert TrainingSettings.from_document(document) == settings()


def test_an_environment_that_no_planner_can_drive_in_is_refused_demonstrations(tmp_path):
    with pytest.raises(TrainingError, match="what a planner needs to know"):
        train(tmp_path / "t", settings(demonstrations=99))


def test_demonstrations_bring_no_promotion(tmp_path):
    stages = tuple(Stage(str(far), (Family.NORMAL,), far, nearest=far, steps=40) for far in (4.0, 8.0))
    lessons = Curriculum(0, stages, Promotion(1.0, 1))
    wanted = settings(environment=ENVIRONMENT, demonstrations=50, random_episodes=0)
    trainer = Trainer(tmp_path / "t", wanted, parallel=False, curriculum=lessons)
    rows = [event for event in trainer.run() if isinstance(event, EpisodeDone)]
    assert [row.success for row in rows] == [False, True, False, True]
    assert {row.stage for row in rows} == {"4.0"} and trainer.progress.curriculum["episodes"] == 4
