"""The results page in a real browser: the table, a mission from above, and from there two ghosts in 3D."""

import pytest
from asking import PATIENCE_MS
from playwright.sync_api import Page, expect

from app.results import SAMPLE, Evaluation
from app.results_tables import around, shown

pytestmark = pytest.mark.browser


def test_from_the_table_to_two_ghosts_in_the_scene(page: Page, server):
    page.get_by_role("link", name="Results").click()
    expect(page.locator("#table tr.bound").first).to_be_visible(timeout=PATIENCE_MS)
    expect(page.locator("#table .paper").first).to_contain_text("paper")
    expect(page.locator("#paired tbody tr").first).to_be_visible(timeout=PATIENCE_MS)
    rows = page.locator("#drives tr[data-mission]")
    rows.nth(1).click()
    expect(rows.nth(1)).to_have_attribute("aria-selected", "true")
    ways = page.locator("#map .way:not(.under)")
    expect(ways.first).to_be_visible(timeout=PATIENCE_MS)
    expect(page.locator("#ways li")).to_have_count(ways.count(), timeout=PATIENCE_MS)
    assert page.locator("#problem").inner_text() == ""

    page.get_by_role("button", name="Replay in 3D").click()
    viewer = page.frame_locator("#viewer")
    expect(viewer.get_by_text("End the replay")).to_be_visible(timeout=PATIENCE_MS)
    expect(page.locator("#scenario")).to_contain_text("covert", timeout=PATIENCE_MS)
    assert server.ask("/api/mission")["status"] == "idle"


DRAW = """async (rows) => {
  const { showTable } = await import("/static/js/results_tables.js");
  const table = document.createElement("table");
  showTable(table, rows, [], []);
  return [...table.tBodies[0].rows].map((row) => [...row.cells].map((cell) => cell.innerText));
}"""


def test_figures_are_rounded_as_in_the_exported_tables(page: Page, server):
    rows = [row | {"paper": None} for row in Evaluation(SAMPLE).rows]
    rows += [rows[0] | {"success_rate": rate, "exposed_s": 5.25} for rate in (0.625, 0.985, 0.995, 0.005)]
    for row, cells in zip(rows, page.evaluate(DRAW, rows), strict=True):
        low, high = row["success_ci95"]
        share = f"{shown(row['success_rate'], '.0%')} ({shown(low, '.0%')}–{shown(high, '.0%')})"
        assert cells[3] == share
        assert cells[7] == shown(row["exposed_s"], ".1f") + around(row, "exposed_s", ".1f")
        assert cells[10] == shown(row["avoidable_removed"], ".0%") + around(row, "avoidable_removed", ".0%")
