"""The studio in a real browser: see the scene, click a goal, place an observer, watch the robot drive."""

import io
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from asking import PATIENCE_MS, dismiss_warning
from PIL import Image
from playwright.sync_api import FrameLocator, Page, expect

from app.view.camera import FIELD_OF_VIEW, Viewpoint, opening_view
from app.view.gizmo import LIFT
from scenes.library import load_shipped
from scenes.rays import RayScene
from scenes.scenario import Scenario, why_not_standing

pytestmark = pytest.mark.browser

DRIVE = 3.5
"""Metres to drive: far enough to be a drive, near enough for a machine that also renders in software."""
HANDLE = 0.45
"""Metres from an observer, along both of its axes, to the square between the arrows of its handles."""


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_shipped("meadow")


@pytest.fixture(scope="module")
def viewer(page: Page) -> FrameLocator:
    """The 3D view once it is connected and its panel stands."""
    frame = page.frame_locator("#viewer")
    frame.get_by_role("button", name="Goal", exact=True).wait_for()
    dismiss_warning(frame)
    return frame


def wait_for(
    ask: Callable[[], Any], wanted: Callable[[Any], bool], patience_s: float = PATIENCE_MS / 1000
) -> Any:
    """Ask until the answer is as wanted."""
    end = time.monotonic() + patience_s
    while True:
        answer = ask()
        if wanted(answer):
            return answer
        assert time.monotonic() < end, f"still {answer}"
        time.sleep(0.2)


def colours(page: Page) -> int:
    """How many clearly different colours the middle of the scene shows."""
    box = page.locator("#viewer").bounding_box()
    assert box is not None
    clip = {"x": box["x"] + 230, "y": box["y"] + 60, "width": 380, "height": 420}
    image = Image.open(io.BytesIO(page.screenshot(clip=clip, timeout=PATIENCE_MS))).convert("RGB")
    return len(np.unique(np.asarray(image).reshape(-1, 3) // 16, axis=0))


def pixel(point: np.ndarray, view: Viewpoint, canvas: dict) -> tuple[float, float]:
    """Where a world point appears on the page: the pinhole camera written down once more."""
    forward = (view.look_at - view.position) / np.linalg.norm(view.look_at - view.position)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    offset = point - view.position
    scale = 0.5 * canvas["height"] / math.tan(0.5 * FIELD_OF_VIEW) / (offset @ forward)
    x = canvas["x"] + 0.5 * canvas["width"] + scale * (offset @ right)
    y = canvas["y"] + 0.5 * canvas["height"] - scale * (offset @ np.cross(right, forward))
    return x, y


def open_ground(scenario: Scenario, page: Page, viewer: FrameLocator, distance: float, skip: int = 0):
    """A point of the ground `distance` metres from the start that the camera sees, and its pixel."""
    heightmap = scenario.terrain.heightmap()
    rays = RayScene(heightmap, scenario.cover)
    view = opening_view(scenario, heightmap, rays)
    canvas = viewer.locator("canvas").first.bounding_box()
    assert canvas is not None
    toward = math.atan2(scenario.goal.y - scenario.start.y, scenario.goal.x - scenario.start.x)
    for turn in np.radians([0, 15, -15, 30, -30, 45, -45, 60, -60])[skip:]:
        x = scenario.start.x + distance * math.cos(toward + turn)
        y = scenario.start.y + distance * math.sin(toward + turn)
        if why_not_standing(heightmap, scenario.cover, x, y):
            continue
        point = np.array([x, y, float(heightmap.height_at(x, y))])
        offset = point - view.position
        span = float(np.linalg.norm(offset))
        if abs(float(rays.cast(view.position, offset[None] / span, 2 * span).distance[0]) - span) < 0.05:
            return (x, y), pixel(point, view, canvas)
    raise AssertionError("the camera sees no open ground there")


def arm(page: Page, viewer: FrameLocator, tool: str) -> None:
    viewer.get_by_role("button", name=tool, exact=True).click()
    expect(page.locator("#pointer")).not_to_be_empty(timeout=PATIENCE_MS)


def disarm(page: Page) -> None:
    page.keyboard.press("Escape")
    expect(page.locator("#pointer")).to_be_empty(timeout=PATIENCE_MS)


def test_the_page_opens_with_the_token_and_says_what_is(page, server):
    expect(page.locator("#scenario")).to_have_text("meadow", timeout=PATIENCE_MS)
    expect(page.locator("#link")).to_have_attribute("data-state", "live", timeout=PATIENCE_MS)
    assert "token" not in page.url


def test_the_scene_is_seen(page, viewer):
    assert wait_for(lambda: colours(page), lambda count: count >= 40) >= 40


def test_a_click_with_the_goal_tool_sets_the_goal_under_the_cursor(page, viewer, server, scenario):
    (x, y), where = open_ground(scenario, page, viewer, DRIVE)
    arm(page, viewer, "Goal")
    before = server.ask("/api/mission")["goal"]
    page.mouse.click(*where)
    goal = wait_for(lambda: server.ask("/api/mission")["goal"], lambda goal: goal != before)
    assert math.dist((goal["x"], goal["y"]), (x, y)) < 0.3
    disarm(page)


def test_an_observer_placed_by_a_click_appears_in_the_interface(page, viewer, server, scenario):
    (x, y), where = open_ground(scenario, page, viewer, 7.0, skip=1)
    arm(page, viewer, "Observer")
    before = server.ask("/api/observers")
    page.mouse.click(*where)
    after = wait_for(lambda: server.ask("/api/observers"), lambda them: len(them) == len(before) + 1)
    assert math.dist((after[-1]["x"], after[-1]["y"]), (x, y)) < 0.3
    disarm(page)


def test_the_handles_move_what_is_selected_and_the_drag_is_one_step_back(page, viewer, server, scenario):
    """The square between the handles' arrows, dragged 2 m back and 0.5 m to the left."""
    placed = server.ask("/api/observers")[-1]
    heightmap = scenario.terrain.heightmap()
    view = opening_view(scenario, heightmap, RayScene(heightmap, scenario.cover))
    canvas = viewer.locator("canvas").first.bounding_box()
    ground = float(heightmap.height_at(placed["x"], placed["y"]))

    def beside(ahead: float, left: float) -> np.ndarray:
        yaw = math.radians(placed["yaw"])
        turned = complex(ahead, left) * complex(math.cos(yaw), math.sin(yaw))
        return np.array([placed["x"] + turned.real, placed["y"] + turned.imag, ground + LIFT])

    target = beside(-2.0, 0.5)
    page.mouse.move(*pixel(beside(HANDLE, HANDLE), view, canvas))
    page.mouse.down()
    page.mouse.move(*pixel(beside(HANDLE - 2.0, HANDLE + 0.5), view, canvas), steps=5)
    page.mouse.up()
    moved = wait_for(
        lambda: server.ask("/api/observers")[-1],
        lambda observer: math.dist((observer["x"], observer["y"]), target[:2]) < 0.1,
    )
    assert moved == placed | {"x": moved["x"], "y": moved["y"]}
    page.locator("#scenario").click()
    page.keyboard.press("Control+z")
    wait_for(lambda: server.ask("/api/observers")[-1], lambda observer: observer == placed)


def test_undo_and_redo_work_from_the_page_around_the_view(page, viewer, server):
    placed = len(server.ask("/api/observers"))
    page.locator("#scenario").click()
    page.keyboard.press("Control+z")
    wait_for(lambda: len(server.ask("/api/observers")), lambda count: count == placed - 1)
    page.keyboard.press("Control+Shift+Z")
    wait_for(lambda: len(server.ask("/api/observers")), lambda count: count == placed)


def test_play_drives_the_robot_to_the_goal(page, viewer, server):
    goal = server.ask("/api/mission")["goal"]
    page.locator("#play").click()
    done = ("reached", "collided", "stuck", "timeout", "unreachable", "rolled_over")
    mission = wait_for(lambda: server.ask("/api/mission"), lambda mission: mission["status"] in done)
    assert mission["status"] == "reached"
    assert math.dist((mission["pose"]["x"], mission["pose"]["y"]), (goal["x"], goal["y"])) < 0.5
    expect(page.locator("#status")).to_have_attribute("data-status", "reached", timeout=PATIENCE_MS)


def test_the_question_mark_lists_the_keys(page, viewer):
    page.locator("#scenario").click()
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_visible()
    expect(page.locator("#keys-list")).to_contain_text("follow the robot")
    page.keyboard.press("Escape")
    expect(page.locator("#keys")).not_to_be_visible()
