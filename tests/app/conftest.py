"""Fixtures of the app's tests; a module with needs of its own has its own of the same name."""

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser
from meadows import meadow_scene
from served import silent_studio

from app.studio import Studio
from app.view import StudioView
from scenes.scenario import Scenario


@pytest.fixture
def meadow() -> Scenario:
    return meadow_scene()


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    """What the view draws on."""
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        yield server
        server.stop()


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return silent_studio(tmp_path, meadow_scene())


@pytest.fixture
def view(server: viser.ViserServer, studio: Studio) -> Iterator[StudioView]:
    server.scene.reset()
    server.gui.reset()
    view = StudioView(studio, server)
    yield view
    view.close()
