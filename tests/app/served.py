"""A studio without its mission process, and the application around it."""

from pathlib import Path

from fastapi import FastAPI
from fastapi.testclient import TestClient

from app.server import create_app
from app.settings import Settings
from app.store import Store
from app.studio import Studio
from scenes.scenario import Scenario

TOKEN = "a-token-for-tests"
BEARER = {"Authorization": f"Bearer {TOKEN}"}
BASE = "http://127.0.0.1:8000"
OPEN_ID = "meadow-test"


class SilentWorker:
    """Stands where the mission process would and notes the orders."""

    def __init__(self) -> None:
        self.orders: list[tuple] = []

    def load(self, *arguments) -> int:
        self.orders.append(("load", *arguments))
        return len(self.orders)

    def __getattr__(self, name):
        return lambda *arguments, **keywords: self.orders.append((name, *arguments))


def silent_studio(workspace: Path, scenario: Scenario) -> Studio:
    """A studio for all that is not about driving."""
    studio = Studio(Store(workspace), scenario, OPEN_ID)
    studio._drive.worker = SilentWorker()
    return studio


def application(studio: Studio, **settings) -> FastAPI:
    return create_app(studio, Settings.make(token=TOKEN, **settings))


def browser(app: FastAPI, **headers: str) -> TestClient:
    """A client that shows what the server really answers: errors of ours as 500, redirects not followed."""
    return TestClient(app, BASE, raise_server_exceptions=False, follow_redirects=False, headers=headers)


def http_scope(method: str, path: str, raw_path: bytes, headers: list[tuple[bytes, bytes]]) -> dict:
    """A request as the server hands it on, whose path no client library has tidied up."""
    return {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": method,
        "scheme": "http",
        "path": path,
        "raw_path": raw_path,
        "root_path": "",
        "query_string": b"",
        "headers": headers,
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 8000),
    }
