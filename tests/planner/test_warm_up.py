"""After warming up, no kernel is left to compile."""

from numba.core import event

from planner.methods import METHODS
from planner.mission import Mission
from planner.warm_up import warm_up
from scenes.library import load_shipped


def test_a_mission_after_warming_up_compiles_nothing():
    warm_up()
    with event.install_recorder("numba:compile") as recorder:
        for method in (*METHODS, "least_cost+dwa_rl"):
            mission = Mission(load_shipped("village-street"), method)
            for _ in range(6):
                mission.tick()
            mission.close()
    compiled = {str(happened.data["dispatcher"]) for _, happened in recorder.buffer}
    assert not compiled
