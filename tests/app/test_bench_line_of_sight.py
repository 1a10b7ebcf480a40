"""The bench of viewsheds, on a grid small enough for a test."""

import re

import numpy as np
import pytest

from app.bench import line_of_sight


@pytest.fixture(autouse=True)
def small_grounds(monkeypatch):
    monkeypatch.setattr(line_of_sight, "SIDE", 64)
    monkeypatch.setattr(line_of_sight, "ROW", 20)
    monkeypatch.setattr(line_of_sight, "COLUMN", 30)
    monkeypatch.setattr(line_of_sight, "REPEATS", 1)
    monkeypatch.setattr(line_of_sight, "_grounds", line_of_sight._grounds.__wrapped__)


def test_our_cells_are_the_peers_on_every_ground():
    result = line_of_sight.viewshed()
    assert result.name == "viewshed" and result.unit == "ms"
    assert "all 64² cells the same on 5 of 5 grounds" in result.identical
    assert re.search(r"xarray-spatial( \d|: not installed)", result.identical)


def test_gdal_sees_about_the_same_where_rasterio_brings_it_along():
    theirs = line_of_sight._gdal()
    if theirs is None:
        pytest.skip("this rasterio is built against another GDAL")
    assert theirs(np.zeros((64, 64))).all()
    ground = line_of_sight._grounds()["fractal"]
    assert (theirs(ground) == line_of_sight._ours(ground)).mean() > 0.95
