"""A studio in a process of its own, and a real Chromium that looks at it."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from asking import PATIENCE_MS, TOKEN, Server
from playwright.sync_api import Browser, Page, sync_playwright

from app.training_process import NICENESS

FAILURES = Path(__file__).parent / "failures"
WINDOW = {"width": 1000, "height": 620}
PATIENT = NICENESS + 5
CHROMIUM_FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[Server]:
    command = [sys.executable, "-c", "from app.cli import main; raise SystemExit(main())", "serve", "meadow"]
    options = ["--port", "0", "--token", TOKEN, "--workspace", str(tmp_path_factory.mktemp("workspace"))]
    process = subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2],
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        address = next((line.strip() for line in process.stdout if line.startswith("http://")), None)
        assert address, "the server ended without saying where it is"
        yield Server(address)
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()


@pytest.fixture(scope="session")
def patient_chromium(tmp_path_factory) -> Path:
    """Chromium that leaves the processor to the studio and its trainings, for it draws as fast as it can.
    Started by root it would give itself precedence over everything else."""
    launcher = tmp_path_factory.mktemp("chromium") / "chromium"
    humbled = "setpriv --bounding-set=-sys_nice " if os.geteuid() == 0 else ""
    launcher.write_text(f'#!/bin/sh\nexec {humbled}nice -n {PATIENT} {shutil.which("chromium")} "$@"\n')
    launcher.chmod(0o755)
    return launcher


@pytest.fixture(scope="module")
def chromium(patient_chromium: Path) -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=patient_chromium, args=CHROMIUM_FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def page(chromium: Browser, server: Server) -> Iterator[Page]:
    """The studio's page as on a later visit, opened with the token."""
    context = chromium.new_context(viewport=WINDOW)
    context.set_default_timeout(PATIENCE_MS)
    context.add_init_script("localStorage.setItem('covernav.visited', 'yes')")
    page = context.new_page()
    page.goto(server.address)
    yield page
    context.close()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item):
    """Leave a picture of the page where a test failed."""
    outcome = yield
    page = getattr(item, "funcargs", {}).get("page")
    if outcome.get_result().failed and page is not None:
        FAILURES.mkdir(exist_ok=True)
        page.screenshot(path=FAILURES / f"{item.name}.png", timeout=PATIENCE_MS)
