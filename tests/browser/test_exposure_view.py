"""Who sees what in a real browser: overlay, an observer who changes, a place explained, routes compared."""

import io

import numpy as np
import pytest
from asking import PATIENCE_MS, open_tab
from PIL import Image
from playwright.sync_api import FrameLocator, Page, expect
from test_page import arm, disarm, open_ground, wait_for

from app.view import palette
from scenes.library import load_shipped

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def scenario():
    return load_shipped("meadow")


@pytest.fixture(scope="module")
def viewer(page: Page) -> FrameLocator:
    """The 3D view with the tab about exposure open."""
    return open_tab(page, "Exposure")


def shares(page: Page) -> tuple[float, float]:
    """Shares of the scene's pixels that are orange and blue-green, shaded or not."""
    box = page.locator("#viewer").bounding_box()
    assert box is not None
    clip = {"x": box["x"] + 230, "y": box["y"] + 60, "width": 380, "height": 420}
    image = Image.open(io.BytesIO(page.screenshot(clip=clip, timeout=PATIENCE_MS))).convert("RGB")
    pixels = np.asarray(image, float).reshape(-1, 3)
    hue = pixels / np.maximum(np.linalg.norm(pixels, axis=1, keepdims=True), 1.0)
    targets = np.array([palette.SEEN, palette.HIDDEN], float)
    targets /= np.linalg.norm(targets, axis=1, keepdims=True)
    near = hue @ targets.T > 0.97
    return float(near[:, 0].mean()), float(near[:, 1].mean())


def test_seen_ground_is_orange_and_hidden_ground_blue_green(page, viewer):
    orange, green = wait_for(lambda: shares(page), lambda now: min(now) > 0.02)
    assert orange + green > 0.15


def test_an_observer_who_turns_takes_the_orange_along(page, viewer, server):
    observer = server.ask("/api/observers")[0]
    before = wait_for(lambda: shares(page), lambda now: min(now) > 0.02)
    server.ask(f"/api/observers/{observer['id']}", "PATCH", {"range": 0.0})
    wait_for(lambda: shares(page), lambda now: now[0] < 0.5 * before[0] and now[1] > before[1])
    server.ask(f"/api/observers/{observer['id']}", "PATCH", {"range": observer["range"]})
    wait_for(lambda: shares(page), lambda now: now[0] > 0.5 * before[0])


def test_a_clicked_place_is_explained(page, viewer, server, scenario):
    (x, y), where = open_ground(scenario, page, viewer, 5.0)
    arm(page, viewer, "Explain a place (E)")
    page.mouse.click(*where)
    section = viewer.get_by_role("img", name="section from observer").first
    section.wait_for(timeout=PATIENCE_MS)
    profile = server.ask(f"/api/exposure/profile?observer=1&x={x}&y={y}")
    expect(viewer.get_by_text(profile["reason"].split(",")[0].split(":")[0]).first).to_be_visible()
    disarm(page)


def test_routes_stand_side_by_side_and_one_is_followed(page, viewer, server):
    viewer.get_by_role("button", name="Compare routes from here").click()
    follow = viewer.get_by_role("button", name="Most hidden", exact=True)
    follow.wait_for(timeout=PATIENCE_MS)
    expect(viewer.get_by_role("cell", name="Shortest")).to_be_visible()
    follow.click()
    mission = wait_for(lambda: server.ask("/api/mission"), lambda mission: mission["time_s"] > 0.3)
    assert mission["method"] == "route"
    server.ask("/api/mission/stop", "POST")
