"""Checkpoints: what is written comes back, and what does not belong here is refused by name."""

import numpy as np
import pytest
from dgs.core.errors import CheckpointError
from dgs.core.training.checkpoint import Checkpoint, load_checkpoint, save_checkpoint

FINGERPRINT = {"settings": {"seed": 0, "steps": 10}, "photos": ["a.png", "b.png"], "blur space": "srgb"}


@pytest.fixture
def kept(tmp_path):
    arrays = {"value.means": np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)}
    checkpoint = Checkpoint(arrays, FINGERPRINT, 7, 1.25, [{"step": 7, "loss": 0.5}], {"steps": 7})
    save_checkpoint(tmp_path / "kept.npz", checkpoint)
    return tmp_path / "kept.npz"


def test_round_trip(kept):
    back = load_checkpoint(kept, FINGERPRINT)
    assert (back.step, back.seconds, back.counters) == (7, 1.25, {"steps": 7})
    assert back.history == [{"step": 7, "loss": 0.5}]
    assert np.array_equal(back.arrays["value.means"], np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32))
    assert [path.name for path in kept.parent.iterdir()] == ["kept.npz"], "no temporary file is left"


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_truncated(kept, share):
    content = kept.read_bytes()
    kept.write_bytes(content[: int(share * len(content))])
    with pytest.raises(CheckpointError, match=r"kept\.npz' is damaged"):
        load_checkpoint(kept, FINGERPRINT)


def test_flipped_bytes(kept):
    content = bytearray(kept.read_bytes())
    for at in range(len(content) // 3, len(content) // 3 + 40):
        content[at] ^= 0xFF
    kept.write_bytes(bytes(content))
    with pytest.raises(CheckpointError, match=r"kept\.npz' is damaged"):
        load_checkpoint(kept, FINGERPRINT)


@pytest.mark.parametrize("content", [b"not an archive at all", b"PK\x03\x04" + bytes(200), b"\x80\x04K\x01."])
def test_foreign_file(kept, content):
    kept.write_bytes(content)
    with pytest.raises(CheckpointError, match=r"kept\.npz' is damaged"):
        load_checkpoint(kept, FINGERPRINT)


def test_archive_of_something_else(kept):
    np.savez(kept, points=np.zeros(3))
    with pytest.raises(CheckpointError, match=r"kept\.npz' is damaged"):
        load_checkpoint(kept, FINGERPRINT)


@pytest.mark.parametrize(
    "change", [{"settings": {"seed": 1, "steps": 10}}, {"photos": ["a.png"]}, {"blur space": "linear"}]
)
def test_checkpoint_of_another_run_names_what_differs(kept, change):
    with pytest.raises(CheckpointError, match=f"kept\\.npz' belongs to a run with another {next(iter(change))}"):
        load_checkpoint(kept, {**FINGERPRINT, **change})
