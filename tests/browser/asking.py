"""What the browser tests share: how to ask the studio, and how long to wait for it."""

import json
import urllib.request
from dataclasses import dataclass
from typing import Any

from playwright.sync_api import FrameLocator, Page

TOKEN = "browser-test"
PATIENCE_MS = 120_000  # software rendering on a busy machine


def open_tab(page: Page, name: str) -> FrameLocator:
    """The 3D view with one of its tabs open, rid of its warning that it renders in software."""
    frame = page.frame_locator("#viewer")
    tab = frame.get_by_role("tab", name=name)
    tab.wait_for()
    close = frame.locator(".mantine-Notification-root button")
    if close.count():
        close.first.click()
    tab.click()
    return frame


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
