"""A Ray cluster: the same results as here, even when a node is killed in the middle; a clear word without."""

import importlib
import sys
import threading
import time
from functools import partial
from pathlib import Path
from types import ModuleType

import pytest
from held_drives import LET_GO, attempt

from planner.evaluation import specs
from planner.evaluation_cluster import Cluster, ClusterError
from planner.evaluation_run import Local, evaluate
from planner.evaluation_table import tabulate
from planner.frames import Perception
from scenes.scenario import Family


def without_clock(rows):
    """A table but for its planner's milliseconds."""
    return [{name: value for name, value in row.items() if "_ms" not in name} for row in rows]


def missing(name):
    raise ImportError(name)


def a_folder_that_has_its_name(name):
    return ModuleType(name)


@pytest.mark.parametrize("found", [missing, a_folder_that_has_its_name])
def test_without_ray_it_says_how_to_install_it(monkeypatch, found):
    monkeypatch.setattr(importlib, "import_module", found)
    with pytest.raises(ClusterError, match=r"pip install '\.\[cluster\]'"):
        Cluster("auto")


def test_a_table_is_the_same_with_a_node_killed_in_the_middle(tmp_path, monkeypatch):
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster as Machines

    monkeypatch.setenv("PYTHONPATH", ":".join([str(Path(__file__).parent), *filter(None, sys.path)]))
    wanted = specs(["dwa"], [Family.NORMAL], 4, 0, Perception.ORACLE, 6.0)
    machines = Machines(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    workers = [machines.add_node(num_cpus=1) for _ in range(2)]
    machines.wait_for_nodes()

    def kill_when_busy():
        end = time.monotonic() + 120.0
        while len(list(tmp_path.iterdir())) < len(workers) and time.monotonic() < end:
            time.sleep(0.05)
        ours = importlib.import_module("ray._private.worker").global_worker.node  # it carries this process
        other = next(node for node in workers if node._raylet_socket_name != ours._raylet_socket_name)
        machines.remove_node(other, allow_graceful=False)
        (tmp_path / LET_GO).touch()

    killer = threading.Thread(target=kill_when_busy)
    try:
        killer.start()
        there = list(evaluate(wanted, Cluster(machines.address, partial(attempt, tmp_path))))
        killer.join()
    finally:
        machines.shutdown()
    begun = len(list(tmp_path.iterdir())) - 1
    assert begun == len(wanted) + 1, "what the lost node was driving was driven again, and nothing else"
    assert all(result["status"] == "reached" for result in there)
    here = list(evaluate(wanted, Local(1)))
    assert without_clock(tabulate(there)) == without_clock(tabulate(here))
