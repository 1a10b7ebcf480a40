"""CoverNav's planner over the robot's own map."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
import torch
from maps import grid_map
from test_sensed_exposure import EAST, HERE, known, standing

from planner.exposure_network import ExposureNetwork, save_network
from planner.frames import CoverEstimate
from planner.learning_errors import PolicyError
from planner.methods import Learned, make_method
from planner.methods.covernav import CoverNav, CoverNavConfig
from scenes.catalogue import CoverKind


def route_of(seen) -> np.ndarray:
    decision = make_method("covernav").decide(seen)
    assert decision.route is not None
    return decision.route


def length(points: np.ndarray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


# A wall south of the straight way west, in view of an observer in the south.
WATCHER = EAST.model_copy(update={"x": 0.0, "y": -7.5})
SCREEN = standing(grid_map(), lambda x, y: (abs(y + 1.5) < 0.15) & (x < -0.5) & (x > -7.0))


def test_without_observers_it_drives_the_shortest_way() -> None:
    seen = replace(known(SCREEN), goal=(-6.0, 1.5))
    assert length(route_of(seen)) < 1.1 * math.dist((0.0, 0.0), (-6.0, 1.5))


def test_it_goes_behind_what_hides_it() -> None:
    screen = standing(grid_map(), lambda x, y: (abs(y - 1.0) < 0.15) & (x < -1.0) & (x > -6.0))
    straight = route_of(replace(known(screen), goal=(-7.0, 0.0)))
    hidden = route_of(replace(known(screen, WATCHER), goal=(-7.0, 0.0)))
    assert straight[:, 1].max() < 0.5 and hidden[:, 1].max() > 1.5
    assert length(hidden) <= CoverNavConfig().longest * length(straight)


def test_no_detour_is_longer_than_allowed() -> None:
    config = CoverNavConfig(longest=1.0, detour=1.0)
    seen = replace(known(SCREEN, WATCHER), goal=(-6.0, 4.5))
    strict, free = CoverNav(config).decide(seen).route, CoverNav().decide(seen).route
    assert strict is not None and free is not None
    assert length(strict) <= length(free)


def test_it_hugs_nothing_for_the_sake_of_being_hidden() -> None:
    seen = replace(known(SCREEN, WATCHER), goal=(-6.0, 0.0))
    route = route_of(seen)
    screen = np.array([(x, -1.5) for x in np.arange(-7.0, -0.4, 0.2)])
    gap = np.min(np.hypot(*(route[:, None] - screen[None]).transpose(2, 0, 1)))
    assert gap > 0.6


def test_a_mission_can_be_gone_on_with_from_a_pickle() -> None:
    method = CoverNav()
    seen = replace(known(SCREEN, WATCHER), goal=(-6.0, 4.5))
    method.decide(seen)
    again = pickle.loads(pickle.dumps(method))
    later = replace(seen, time_s=1.0)
    one, other = method.decide(later), again.decide(later)
    assert one.command == other.command
    np.testing.assert_array_equal(one.route, other.route)


def test_it_stands_still_where_there_is_no_way() -> None:
    walled = standing(grid_map(), lambda x, y: (np.hypot(x, y) > 1.6) & (np.hypot(x, y) < 2.0))
    decision = CoverNav().decide(replace(known(walled, WATCHER), goal=(-6.0, 4.5), pose=HERE))
    assert decision.route is None and decision.note.startswith("no route")


def test_with_weights_the_network_has_its_say_and_is_named(tmp_path) -> None:
    torch.manual_seed(0)
    network = ExposureNetwork((8, 8, 8))
    torch.nn.init.constant_(network.last.bias, 50.0)  # it takes all ground to be in view
    named = save_network(tmp_path / "always.safetensors", network)
    method = make_method("covernav", weights=tmp_path / "always.safetensors")
    assert isinstance(method, Learned) and method.policy == named
    screen = standing(grid_map(), lambda x, y: (abs(y - 1.0) < 0.15) & (x < -1.0) & (x > -6.0))
    route = method.decide(replace(known(screen, WATCHER), goal=(-7.0, 0.0))).route
    assert route is not None and route[:, 1].max() < 0.5  # where nothing hides, no detour is worth it
    later = replace(known(screen, WATCHER), goal=(-7.0, 0.0), time_s=1.0)
    assert pickle.loads(pickle.dumps(method)).decide(later).command == method.decide(later).command


def test_weights_that_are_none_are_refused(tmp_path) -> None:
    (tmp_path / "w.safetensors").write_bytes(b"no weights")
    with pytest.raises(PolicyError, match="not a safetensors file"):
        make_method("covernav", weights=tmp_path / "w.safetensors")


def test_its_variants_leave_out_what_they_say() -> None:
    screen = standing(grid_map(), lambda x, y: (abs(y - 1.0) < 0.15) & (x < -1.0) & (x > -6.0))
    watched = replace(known(screen, WATCHER), goal=(-7.0, 0.0))
    no_exposure = make_method("covernav[no_exposure]").decide(watched).route
    assert no_exposure is not None and no_exposure[:, 1].max() < 0.5 < route_of(watched)[:, 1].max()
    fence = CoverEstimate(1, CoverKind.FENCE, -3.5, 1.0, 0.0, 5.0, 3.0, 0.9)
    seen_through = replace(watched, cover=(fence,))
    blind, sees = (make_method(name).decide(seen_through).cost for name in ("covernav[no_cover]", "covernav"))
    assert blind is not None and sees is not None and np.nansum(sees.cost) > np.nansum(blind.cost)
