"""What the browser tests share: how to ask the studio, and how long to wait for it."""

import contextlib
import json
import urllib.request
from dataclasses import dataclass
from typing import Any

from playwright.sync_api import FrameLocator, Page, TimeoutError, expect

TOKEN = "browser-test"
PATIENCE_MS = 120_000  # software rendering on a busy machine
NOTICE_MS = 10_000


def open_tab(page: Page, name: str) -> FrameLocator:
    """The 3D view with one of its tabs open, rid of its warning that it renders in software."""
    frame = page.frame_locator("#viewer")
    tab = frame.get_by_role("tab", name=name)
    tab.wait_for()
    dismiss_warning(frame)
    tab.click()
    return frame


def dismiss_warning(frame: FrameLocator) -> None:
    """Close the view's warning that it renders in software, unless it goes by itself meanwhile."""
    close = frame.locator(".mantine-Notification-root button")
    if close.count():
        with contextlib.suppress(TimeoutError):
            close.first.click(timeout=NOTICE_MS)
    expect(close).to_have_count(0, timeout=PATIENCE_MS)


@dataclass(frozen=True)
class Server:
    """Where the studio answers, and its interface for programs."""

    address: str

    def ask(self, path: str, method: str = "GET", body: Any = None) -> Any:
        base = self.address.partition("/?")[0]
        request = urllib.request.Request(
            base + path,
            None if body is None else json.dumps(body).encode(),
            {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"},
            method=method,
        )
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)
