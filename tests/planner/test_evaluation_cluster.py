"""A Ray cluster: the same results as here, even when a node is killed in the middle; a clear word without."""

import importlib
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest
from slow_drives import attempt

from planner.evaluation import specs
from planner.evaluation_cluster import Cluster, ClusterError
from planner.evaluation_run import Local, evaluate
from planner.evaluation_table import tabulate
from planner.frames import Perception
from scenes.scenario import Family


def test_without_ray_it_says_how_to_install_it(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(ClusterError, match=r"pip install 'covernav-studio\[cluster\]'"):
        Cluster("auto")


def test_a_table_is_the_same_with_a_node_killed_in_the_middle(tmp_path, monkeypatch):
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster as Machines

    monkeypatch.setenv("PYTHONPATH", ":".join([str(Path(__file__).parent), *filter(None, sys.path)]))
    wanted = specs(["dwa"], [Family.NORMAL], 8, 0, Perception.LIDAR, 12.0)
    marks = tmp_path / "marks"
    marks.mkdir()
    machines = Machines(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    workers = [machines.add_node(num_cpus=1) for _ in range(2)]
    machines.wait_for_nodes()

    def kill_when_busy():
        end = time.monotonic() + 60.0
        while len(list(marks.iterdir())) < 3 and time.monotonic() < end:
            time.sleep(0.05)
        ours = importlib.import_module("ray._private.worker").global_worker.node  # it carries this process
        other = next(node for node in workers if node._raylet_socket_name != ours._raylet_socket_name)
        machines.remove_node(other, allow_graceful=False)

    killer = threading.Thread(target=kill_when_busy)
    try:
        killer.start()
        there = list(evaluate(wanted, Cluster(machines.address, partial(attempt, marks))))
        killer.join()
    finally:
        machines.shutdown()
    here = list(evaluate(wanted, Local(1, partial(attempt, marks))))
    assert all(result["status"] == "reached" for result in there)
    assert tabulate(there) == tabulate(here)
    assert len(list(marks.iterdir())) > 2 * len(wanted), "what the lost node drove was driven again"
