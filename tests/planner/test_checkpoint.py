"""Weights on disk: what is no good is refused in one clear sentence."""

import json
import pickle

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from planner.checkpoint import load_policy, read_tensors, save_policy, weights, write_file, write_tensors
from planner.learning_errors import PolicyError
from planner.networks import Actor, Architecture


@pytest.fixture
def saved(tmp_path):
    actor, path = Actor(), tmp_path / "good.safetensors"
    return actor, path, save_policy(path, actor, {"seed": "3"})


def test_a_policy_comes_back_as_it_was(saved):
    actor, path, name = saved
    found, again = load_policy(path)
    layers, state = torch.randn(2, 1, 40, 40), torch.randn(2, 25)
    assert torch.equal(found(layers, state), actor(layers, state))
    assert name == again and name.name == "good" and len(name.sha256) == 64
    assert read_tensors(path)[1]["seed"] == "3"


def test_the_same_content_is_the_same_bytes_whatever_the_order_of_its_metadata(tmp_path):
    about = {f"key {number}": str(number) for number in range(8)}
    backwards = dict(reversed(about.items()))
    tensors = {"weight": np.arange(6, dtype=np.float32)}

    shas = {write_tensors(tmp_path / "file.safetensors", tensors, order) for order in (about, backwards)}

    assert len(shas) == 1


@given(
    about=st.dictionaries(st.text(max_size=9), st.text(max_size=20), max_size=4),
    sizes=st.lists(st.integers(0, 9), max_size=3),
)
def test_metadata_and_tensors_come_back_as_they_were(tmp_path_factory, about, sizes):
    path = tmp_path_factory.getbasetemp() / "come_back.safetensors"
    tensors = {f"{number}": np.arange(size, dtype=np.float32) for number, size in enumerate(sizes)}

    sha = write_tensors(path, tensors, about)

    found, metadata, found_sha = read_tensors(path)
    assert (metadata, found_sha) == (about, sha)
    assert {name: tensor.tolist() for name, tensor in found.items()} == {
        name: tensor.tolist() for name, tensor in tensors.items()
    }


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(PolicyError, match=r"none\.safetensors cannot be read: No such file"):
        load_policy(tmp_path / "none.safetensors")


@pytest.mark.parametrize("kept", [0, 5, 400, -1])
def test_a_truncated_file_is_refused(saved, kept):
    _, path, _ = saved
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(PolicyError, match="is truncated, or not a safetensors file"):
        load_policy(path)


def test_a_pickle_is_refused_without_being_opened(tmp_path):
    path = tmp_path / "weights.pt"
    path.write_bytes(pickle.dumps({"a": np.zeros(3)}))
    with pytest.raises(PolicyError, match="not a safetensors file"):
        load_policy(path)


def test_another_architecture_is_refused(tmp_path):
    path = tmp_path / "p.safetensors"
    save_policy(path, Actor(Architecture(name="resnet")))
    with pytest.raises(PolicyError, match=r"architecture 'resnet', not 'terp_cbam'"):
        load_policy(path)
    write_tensors(path, weights(Actor()))
    with pytest.raises(PolicyError, match="does not say which architecture"):
        load_policy(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.pop("head.0.weight"), r"lacks the tensor 'head\.0\.weight'"),
        (lambda t: t.update({"head.0.bias": np.zeros(3, np.float32)}), r"shape \(3,\), not \(256,\)"),
        (lambda t: t.update(more=np.zeros(3, np.float32)), "has a tensor 'more'"),
        (lambda t: t["head.0.bias"].fill(np.nan), "not finite"),
    ],
)
def test_tensors_that_do_not_fit_are_named(tmp_path, change, words):
    tensors = weights(Actor())
    change(tensors)
    about = {"architecture": json.dumps({"channels": 1, "state": 25, "name": "terp_cbam"})}
    write_tensors(tmp_path / "p.safetensors", tensors, about)
    with pytest.raises(PolicyError, match=words):
        load_policy(tmp_path / "p.safetensors")


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "kept"
    write_file(path, b"old")
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OSError, match="No space"):
        write_file(path, b"new")
    assert path.read_bytes() == b"old" and [entry.name for entry in tmp_path.iterdir()] == ["kept"]


@pytest.mark.parametrize(
    "said", [{"channels": "6"}, {"channels": -1}, {"state": 10**11}, {"state": 1.5}, {"depth": 3}, []]
)
def test_an_architecture_that_makes_no_sense_is_refused(tmp_path, said):
    path = tmp_path / "odd.safetensors"
    write_tensors(path, weights(Actor()), {"architecture": json.dumps(said)})
    with pytest.raises(PolicyError, match="does not say which architecture"):
        load_policy(path)


@pytest.mark.parametrize("reads", [Architecture(channels=7), Architecture(state=28)])
def test_a_network_that_reads_more_than_a_drive_shows_is_refused(tmp_path, reads):
    path = tmp_path / "odd.safetensors"
    save_policy(path, Actor(reads))
    with pytest.raises(PolicyError, match=r"reads . layers and .. numbers; a drive shows 6 and 27"):
        load_policy(path)
