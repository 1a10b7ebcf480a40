"""What the browser tests share: how to ask the studio, and how long to wait for it."""

import json
import urllib.request
from dataclasses import dataclass
from typing import Any

TOKEN = "browser-test"
PATIENCE_MS = 120_000  # software rendering on a busy machine


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
