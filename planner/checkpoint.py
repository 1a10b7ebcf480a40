"""Weights on disk: safetensors only, written whole or not at all; what is no good is refused in words."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import safetensors
import torch
from safetensors.numpy import load, save
from torch import nn

from planner.learning_errors import PolicyError
from planner.networks import Actor, Architecture
from planner.observation import LAYERS, STATE_SIZE


@dataclass(frozen=True)
class PolicyName:
    """Which weights: the file's stem and the SHA-256 of its bytes."""

    name: str
    sha256: str


def write_file(path: Path, content: bytes) -> None:
    """Write beside, flush to disk, put in place: `path` is the old file or the new one, never a part.

    Raises OSError, leaving nothing behind."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    beside = Path(name)
    try:
        with open(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(beside, 0o644)
        os.replace(beside, path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError:
        beside.unlink(missing_ok=True)
        raise


def write_tensors(
    path: Path, tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str] | None = None
) -> str:
    """Write a safetensors file; returns the SHA-256 of its bytes, which are the same for the same content.

    Raises OSError."""
    plain = save({name: np.ascontiguousarray(tensor) for name, tensor in tensors.items()})  # type: ignore[arg-type]
    content = _with_metadata(plain, metadata) if metadata else plain
    write_file(path, content)
    return hashlib.sha256(content).hexdigest()


def _with_metadata(content: bytes, metadata: Mapping[str, str]) -> bytes:
    """A safetensors file's bytes with metadata in order of their names: `save` puts them in another order in
    every process. The header is JSON after its length in eight bytes, filled up with spaces to a multiple of
    eight; what it says of tensors counts from its end."""
    end = 8 + int.from_bytes(content[:8], "little")
    header = {"__metadata__": dict(sorted(metadata.items())), **json.loads(content[8:end])}
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + content[end:]


def read_tensors(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str], str]:
    """Tensors, metadata and SHA-256 of a safetensors file. Raises PolicyError where it is none."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise PolicyError(f"{path} cannot be read: {error.strerror or error}") from None
    try:
        tensors = load(content)
        with safetensors.safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
    except (safetensors.SafetensorError, ValueError, KeyError) as error:
        raise PolicyError(f"{path} is truncated, or not a safetensors file ({error})") from None
    return tensors, metadata, hashlib.sha256(content).hexdigest()


def weights(network: nn.Module) -> dict[str, np.ndarray]:
    """A copy of a network's parameters by name."""
    return {name: tensor.detach().numpy().copy() for name, tensor in network.state_dict().items()}


def save_policy(path: Path, actor: Actor, about: Mapping[str, str] | None = None) -> PolicyName:
    """Write an actor with what it reads, and `about` as it likes. Raises OSError."""
    metadata = {**(about or {}), "architecture": json.dumps(asdict(actor.architecture))}
    return PolicyName(path.stem, write_tensors(path, weights(actor), metadata))


def load_policy(path: Path, name: str = "terp_cbam") -> tuple[Actor, PolicyName]:
    """The actor in a file, ready to drive. Raises PolicyError where the file is truncated, not safetensors,
    of another architecture than `name`, or holds numbers that are not finite."""
    tensors, metadata, sha256 = read_tensors(path)
    try:
        architecture = Architecture(**json.loads(metadata["architecture"]))
    except (KeyError, TypeError, ValueError):
        raise PolicyError(f"{path} does not say which architecture its weights are of") from None
    if architecture.name != name:
        raise PolicyError(f"{path} holds weights of the architecture {architecture.name!r}, not {name!r}")
    if architecture.channels > len(LAYERS) or architecture.state > STATE_SIZE:
        reads = f"{architecture.channels} layers and {architecture.state} numbers"
        shown = f"{len(LAYERS)} and {STATE_SIZE}"
        raise PolicyError(f"{path} holds weights of a network that reads {reads}; a drive shows {shown}")
    actor = Actor(architecture)
    load_weights(actor, tensors, path)
    return actor.eval(), PolicyName(path.stem, sha256)


def load_weights(network: nn.Module, tensors: Mapping[str, np.ndarray], path: Path) -> None:
    """Put tensors into a network of this shape. Raises PolicyError, naming the first that does not fit."""
    wanted = network.state_dict()
    for name, parameter in wanted.items():
        if name not in tensors:
            raise PolicyError(f"{path} lacks the tensor {name!r}; its weights are of another architecture")
        if tensors[name].shape != tuple(parameter.shape):
            shape = tensors[name].shape
            raise PolicyError(
                f"{path}: the tensor {name!r} has the shape {shape}, not {tuple(parameter.shape)};"
                " its weights are of another architecture"
            )
        if not np.isfinite(tensors[name]).all():
            raise PolicyError(f"{path}: the tensor {name!r} holds a number that is not finite")
    for name in tensors:
        if name not in wanted:
            raise PolicyError(f"{path} has a tensor {name!r} that the network lacks; another architecture")
    network.load_state_dict({name: torch.from_numpy(tensor.copy()) for name, tensor in tensors.items()})
