"""After warming up, no kernel is left to compile."""

import pytest
from numba.core import event

from planner.methods import DEFAULT_METHOD, METHODS
from planner.mission import Mission
from planner.motion import MOTIONS
from planner.warm_up import warm_up
from scenes.library import load_shipped


@pytest.mark.parametrize("method", [*METHODS, *(f"{DEFAULT_METHOD}+{motion}" for motion in MOTIONS[1:])])
def test_a_mission_after_warming_up_compiles_nothing(method):
    warm_up(method)
    with event.install_recorder("numba:compile") as recorder:
        mission = Mission(load_shipped("village-street"), method)
        for _ in range(6):
            mission.tick()
        mission.close()
    compiled = {str(happened.data["dispatcher"]) for _, happened in recorder.buffer}
    assert not compiled
