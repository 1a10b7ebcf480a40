"""What the view makes of a training: curves, patches forward up, a ghost on the right ground, words."""

import asyncio
import base64
import io
import re

import numpy as np
import pytest
from meadows import meadow_scene
from PIL import Image
from test_view_view import Guest

from app.changes import Change, StudioError
from app.training_plan import TrainingPlan, TrainingStatus
from app.training_process import Drawn, Moved
from app.training_records import Training
from app.training_service import Compared
from app.training_sight import Seen, Sight, TrueGround, perceived
from app.training_trial import Driver, Trial
from app.view import palette
from app.view.curves import loss_curve, return_curve, success_curve, thinned
from app.view.learner import GAP
from app.view.patches import data_url, height_span, patch_colours, patch_surface
from app.view.training_words import checkpoint_words, comparison, pictures, state, trainings_table
from app.view.viewer import Viewer
from planner.observation import LAYERS
from scenes.pose import Pose


def row(number, success=False, losses=True):
    return {
        "number": number, "total": float(number), "terms": {"goal": 2.0, "time": -1.0}, "success": success,
        "exposed_s": 1.5, "losses": {"critic": 0.5, "actor": -1.0} if losses else None,
        "final": "rolled_over", "steps_per_s": 40.0,
    }  # fmt: skip


def sight(episode=0, pose=None):
    truth = TrueGround(meadow_scene()).about(pose or Pose(0.0, 0.0, 0.0), 0.0)
    layers = np.zeros((len(LAYERS), 40, 40), np.float32)
    seen = perceived(layers, np.arange(1600.0).reshape(40, 40), np.full((40, 40), 1000.0))
    return Sight(episode, 3, pose or Pose(0.0, 0.0, 0.0), seen, truth)


def test_curves_are_by_episode_with_rates_of_the_last_twenty():
    rows = [row(number, success=number >= 20, losses=number > 1) for number in range(40)]
    x, curves = return_curve(rows)
    assert x[-1] == 40 and list(curves) == ["return", "goal", "time"]
    _, rate = success_curve(rows)
    share = next(iter(rate.values()))
    assert (share[19], share[29], share[39]) == (0.0, 0.5, 1.0)
    assert len(loss_curve(rows)[0]) == 38 and len(loss_curve([])[0]) == 0
    few, means = thinned((x, curves), 10)
    assert few.tolist() == [4, 8, 12, 16, 20, 24, 28, 32, 36, 40] and means["return"][0] == 1.5


def test_a_picture_has_forward_up_and_left_on_the_left():
    patch = np.zeros((40, 40))
    patch[39, 20] = 1.0  # far left
    patch[20, 39] = 0.6  # far ahead
    address = data_url(patch_colours(Seen.ELEVATION, patch))
    image = Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))).convert("L")
    light = np.asarray(image, int)
    assert np.unravel_index(light.argmax(), light.shape) == (19, 0)
    light[19, 0] = 0
    assert np.unravel_index(light.argmax(), light.shape) == (0, 19)


def test_what_is_unknown_is_clear_and_what_is_barred_is_the_darkest_cost():
    patch = np.array([[0.0, np.nan], [np.inf, 100.0]])
    cost = patch_colours(Seen.COST, patch)
    assert cost[0, 1, 3] == 0 and tuple(cost[1, 0, :3]) == palette.COST_FORBIDDEN
    assert patch_colours(Seen.EXPOSURE, np.array([[np.nan, 1.0]]))[0, :, 3].tolist() == [0, 255]
    assert height_span(np.zeros((2, 2))) == (-0.3, 0.3)


def test_a_patch_lies_about_the_pose_and_ends_with_the_map():
    ground = meadow_scene().terrain.heightmap()
    colours = np.full((40, 40, 4), 255, np.uint8)
    whole = patch_surface(colours, Pose(0.0, 0.0, 0.0), ground, 1.0)
    half = patch_surface(colours, Pose(10.0, 0.0, 0.0), ground, 1.0)
    assert whole is not None and half is not None
    assert np.ptp(whole.vertices[:, 0]) == 19.5 and half.vertices[:, 0].max() <= 10.0
    assert patch_surface(colours, Pose(90.0, 0.0, 0.0), ground, 1.0) is None


def test_the_truth_is_of_the_true_ground():
    truth = TrueGround(meadow_scene()).about(Pose(0.0, 0.0, 0.0), 0.0)
    assert not truth[Seen.ELEVATION].any() and truth[Seen.COVER].any()
    assert truth[Seen.EXPOSURE][16, 28] == 1.0, "observer 1 looks south over open grass"
    assert np.isposinf(truth[Seen.COST]).any(), "the map's edge and the tree bar the way"
    beyond = TrueGround(meadow_scene()).about(Pose(9.0, 0.0, 0.0), 0.0)
    assert np.isnan(beyond[Seen.ELEVATION]).any()


def test_what_the_environment_does_not_give_is_not_shown_as_nothing():
    assert set(sight().seen) == {Seen.ELEVATION, Seen.ATTENTION, Seen.COST}
    assert np.isposinf(sight().seen[Seen.COST]).all()
    assert "nothing of it" in pictures(sight())


def test_a_ghost_drives_on_the_open_map_with_what_it_sees(view, server):
    async def go():
        for report in (Drawn(4, meadow_scene()),):
            view.training._hear(report)
        while view.training._standing:
            await asyncio.sleep(0.01)
        view.training._hear(Moved(3, (Pose(9.0, 9.0, 0.0),)))
        view.training._hear(Moved(4, (Pose(-2.0, 0.0, 0.0), Pose(-1.0, 0.5, 0.0))))
        view.training._hear(sight(4))

    start_studio(view, go)
    ghost = view.training._ground
    assert ghost.offset == 0.0 and ghost._ghost._frame.position.tolist() == [-1.0, 0.5, 0.0]
    assert ghost._ghost._frame.visible and ghost._trail._handle.visible and ghost._overlay._shown is not None
    start_studio(view, lambda: told(view, Change.TRAINING))
    assert not ghost._ghost._frame.visible and ghost._overlay._shown is None, "nobody learns"


def test_another_ground_stands_beside_the_open_map(view, server):
    other = meadow_scene()
    heights = np.array(other.terrain.heights)
    heights[0, 0] += 0.5
    other = other.model_copy(update={"terrain": other.terrain.model_copy(update={"heights": heights})})

    async def go():
        view.training._hear(Drawn(0, other))
        while view.training._standing:
            await asyncio.sleep(0.01)

    start_studio(view, go)
    ground = view.training._ground
    assert ground.offset == 20.0 + GAP and ground._terrain._shown is not None
    viewer = Viewer(view, Guest(server))
    viewer.look_at_learner()
    assert viewer.client.camera.look_at[0] == -3.0 + ground.offset
    start_studio(view, lambda: told(view, Change.OPENED))
    assert ground._terrain._shown is None
    with pytest.raises(StudioError, match="no robot learns"):
        viewer.look_at_learner()


def start_studio(view, go):
    async def run():
        view.studio._loop = asyncio.get_running_loop()
        await go()
        await asyncio.sleep(0.3)

    asyncio.run(run())


async def told(view, change):
    view.training.hear(change)


def test_the_panel_says_how_a_training_goes_and_shows_its_past(view, server):
    service = view.training.service
    training = service._records.add(TrainingPlan(episodes=10), "")
    service._trainings[training.id] = training
    training.status, training.message = TrainingStatus.FAILED, "the critic loss became nan"
    training.episodes = [row(0), row(1, success=True)]

    async def go():
        viewer = view._viewers[1] = Viewer(view, Guest(server))
        view.training.choose(training.id)
        await asyncio.sleep(0.3)
        assert "failed: the critic loss became nan" in viewer.panel.training._state.content
        assert viewer.panel.training._chosen.value == f"{training.id} · curriculum"

    start_studio(view, go)
    words = state(training)
    assert "2 of 10" in words and "rolled over, return 1.0" in words and "50%" in words
    assert "failed" in trainings_table([training], training)
    assert "Nothing has been trained" in state(None)


def test_rates_are_the_policys_own_and_demonstrations_are_counted(tmp_path):
    shown = row(1, success=True) | {"demonstrated": True}
    plan = TrainingPlan(episodes=4, demonstrations=50)
    training = Training(1, "", "", plan, tmp_path, TrainingStatus.RUNNING, episodes=[row(0), shown, row(2)])
    words = state(training)
    assert "3 of 4" in words and "Success, last 2" in words and "return 2.0" in words
    assert "0%" in words and "33%" not in words
    assert re.search(r"Driven by the planner</td>.*?>1<", words)
    assert "0%" in trainings_table([training], training)


def test_two_drives_stand_side_by_side():
    trials = (
        Trial(np.zeros((2, 2)), "rolled_over", 1.0, 4.0, 2.5), Trial(np.zeros((2, 2)), "reached", 6.2, 12, 0)
    )  # fmt: skip
    words = comparison(Compared(1, "episode_000000", "policy", Driver.METHOD, trials))
    assert "before the first episode" in words and "rolled over" in words and "6.2 m" in words
    assert checkpoint_words("episode_000020") == "after episode 20"
