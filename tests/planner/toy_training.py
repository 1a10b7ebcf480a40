"""Trainings short enough for a test, and what is left of them."""

import json

from planner.checkpoint import read_tensors
from planner.ddpg import DdpgConfig
from planner.training import Trainer
from planner.training_settings import TrainingSettings

TOY = "toy_drive:ToyDrive-v0"


def settings(**changed):
    given = {"episodes": 4, "steps": 12, "environment": TOY, "resets": (), "random_episodes": 1}
    return TrainingSettings(**{**given, "ddpg": DdpgConfig(batch=16, buffer=1000), **changed})


def train(folder, wanted=None, **options):
    return list(Trainer(folder, wanted, **{"parallel": False, **options}).run())


def left(folder):
    """What a training leaves that must not differ: networks, optimisers, the policy as a file, the log."""
    progress = json.loads((folder / "checkpoint.json").read_text())
    tensors, _, _ = read_tensors(folder / progress["learner"])
    files = {name: (folder / name).read_bytes() for name in ("policy.safetensors", "episodes.jsonl")}
    return {name: tensor.tobytes() for name, tensor in tensors.items()} | files
