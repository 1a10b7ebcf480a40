"""A training from the panel in a real browser: begun, its curve drawn while the page answers, stopped."""

import time

import pytest
from asking import PATIENCE_MS, open_tab
from playwright.sync_api import FrameLocator, Page, expect
from test_page import wait_for

pytestmark = pytest.mark.browser

TRAINING_PATIENCE_S = 400.0  # it leaves the processor to whatever else is running
SECONDS_TO_ANSWER = 30.0  # of a page in software rendering beside other work


@pytest.fixture(scope="module")
def viewer(page: Page) -> FrameLocator:
    """The 3D view with the tab about training open."""
    return open_tab(page, "Train")


def test_a_training_is_begun_watched_and_stopped_from_the_panel(page, viewer, server):
    viewer.get_by_role("button", name="Start training").click()
    training = wait_for(lambda: server.ask("/api/training"), lambda them: len(them) == 1)[0]
    assert training["plan"]["task"] == "curriculum" and training["plan"]["reward"] == "corrected"
    expect(viewer.get_by_text("Training 1 is")).to_be_visible(timeout=PATIENCE_MS)
    wait_for(
        lambda: server.ask("/api/training/1"), lambda training: training["episodes"] >= 1, TRAINING_PATIENCE_S
    )
    expect(viewer.locator(".uplot").first).to_be_visible(timeout=PATIENCE_MS)
    expect(viewer.get_by_text("What it sees, and the truth")).to_be_visible(timeout=PATIENCE_MS)

    begun = time.monotonic()
    server.ask("/api/mission/start", "POST")
    expect(page.locator("#status")).to_have_attribute("data-status", "running", timeout=PATIENCE_MS)
    assert time.monotonic() - begun < SECONDS_TO_ANSWER
    server.ask("/api/mission/stop", "POST")

    viewer.get_by_role("button", name="Stop", exact=True).last.click()
    ended = wait_for(
        lambda: server.ask("/api/training/1"),
        lambda training: training["status"] == "stopped",
        TRAINING_PATIENCE_S,
    )
    assert ended["episodes"] >= 1 and "policy" in ended["checkpoints"]
    expect(viewer.get_by_text("Training 1 is stopped")).to_be_visible(timeout=PATIENCE_MS)


def test_a_checkpoint_drives_the_mission(viewer, server):
    viewer.get_by_role("button", name="Drive with it").click()
    mission = wait_for(lambda: server.ask("/api/mission"), lambda mission: mission["policy"] is not None)
    assert mission["method"] == "covernav_paper" and mission["policy"].startswith("training-1-episode-")
