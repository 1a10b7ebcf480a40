"""Stages, promotion, and going on from where a training was."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.curriculum import STAGES, Curriculum, Progress, Promotion, Stage
from scenes.scenario import Family

TWO = (Stage("first", (Family.NORMAL,), 4.0), Stage("second", (Family.FOREST,), 12.0, observers=3))
QUICK = Promotion(rate=0.75, episodes=4)


def quick(**changes) -> Curriculum:
    return Curriculum(**({"seed": 3, "stages": TWO, "promotion": QUICK} | changes))


class TestStages:
    def test_goals_get_farther_from_4_to_12_to_50_metres(self) -> None:
        distances = [stage.goal_distance for stage in STAGES]
        assert distances == sorted(distances)
        assert distances[0] == 4.0 and 12.0 in distances and distances[-1] == 50.0

    def test_terrain_goes_from_easy_to_forest_and_observers_from_none_to_three(self) -> None:
        assert STAGES[0].terrains == (Family.NORMAL,) and set(STAGES[-1].terrains) == set(Family)
        watching = [stage.observers for stage in STAGES]
        assert watching == sorted(watching) and watching[0] == 0 and watching[-1] == 3

    def test_patrols_come_before_observers_that_are_not_known(self) -> None:
        names = [stage.name for stage in STAGES]
        walking = next(stage for stage in STAGES if stage.patrols)
        hidden = next(stage for stage in STAGES if stage.unknown)
        assert names.index(walking.name) < names.index(hidden.name)

    @given(st.integers(0, 2**32), st.integers(0, len(STAGES) - 1))
    def test_every_task_is_one_of_its_stage(self, seed, index) -> None:
        stage = STAGES[index]
        task = Curriculum(seed, progress=Progress(stage=index)).task()
        assert task.terrain in stage.terrains
        assert stage.nearest <= task.goal_distance <= stage.goal_distance
        assert 0 <= task.observers <= stage.observers and 0 <= task.obstacles <= stage.obstacles
        assert not task.patrols or stage.patrols
        assert task.known or stage.unknown


class TestPromotion:
    @pytest.mark.parametrize(
        ("outcomes", "stage"),
        [("111", 0), ("1111", 1), ("1110", 1), ("0111", 1), ("1100", 0), ("00111", 1), ("100101", 0)],
    )
    def test_comes_with_enough_successes_among_the_last_episodes(self, outcomes, stage) -> None:
        curriculum = quick()
        for outcome in outcomes:
            curriculum.record(outcome == "1")
        assert curriculum.progress.stage == stage

    def test_the_next_stage_begins_with_a_clean_slate(self) -> None:
        curriculum = quick()
        promoted = [curriculum.record(True) for _ in range(4)]
        assert promoted == [False, False, False, True]
        assert curriculum.progress == Progress(1, (), 4) and not curriculum.finished

    def test_after_the_last_stage_there_is_none(self) -> None:
        curriculum = quick()
        for _ in range(12):
            curriculum.record(True)
        assert curriculum.stage is TWO[1] and curriculum.finished

    @pytest.mark.parametrize("changes", [{"rate": 0.0}, {"rate": 1.1}, {"episodes": 0}])
    def test_makes_sense(self, changes) -> None:
        with pytest.raises(ValueError, match="promotion takes"):
            Promotion(**changes)


class TestGoingOn:
    @given(st.lists(st.booleans(), max_size=30), st.integers(0, 30))
    def test_from_a_saved_state_as_if_never_interrupted(self, outcomes, cut) -> None:
        whole, first = quick(), quick()
        for outcome in outcomes[:cut]:
            first.record(outcome)
        second = quick(seed=99)
        second.restore(json.loads(json.dumps(first.state())))
        for outcome in outcomes:
            whole.record(outcome)
        for outcome in outcomes[cut:]:
            second.record(outcome)
        assert second.state() == whole.state() and second.task() == whole.task()

    def test_tasks_follow_from_the_seed_and_the_episode(self) -> None:
        assert quick().task() == quick().task()
        tasks = []
        curriculum = quick(progress=Progress(stage=1))
        for _ in range(8):
            tasks.append(curriculum.task())
            curriculum.record(False)
        assert len(set(tasks)) > 1
        assert {task.observers for task in tasks} <= {0, 1, 2, 3}

    @pytest.mark.parametrize(
        ("state", "words"),
        [
            ({}, "lacks 'seed'"),
            ({"seed": 0, "stage": 9, "outcomes": [], "episodes": 0}, "stage 9"),
            ({"seed": 0, "stage": -1, "outcomes": [], "episodes": 0}, "whole numbers"),
            ({"seed": 0, "stage": 0, "outcomes": [3], "episodes": 0}, "true or false"),
        ],
    )
    def test_a_state_that_is_none_is_refused(self, state, words) -> None:
        with pytest.raises(ValueError, match=words):
            quick().restore(state)

    def test_progress_beyond_the_stages_is_refused(self) -> None:
        with pytest.raises(ValueError, match="stage 2"):
            quick(progress=Progress(stage=2))
