"""Photos on disk: the same bits as in memory, pages given back at the limit, and one line where the disk is full."""

import errno
import gc
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from dgs.core.errors import OutputError
from dgs.core.photos import store as stores
from dgs.core.photos.load import load_photos
from dgs.core.photos.store import PhotoStore, StoreSettings, held_bytes, kept_beside, store_of
from dgs.core.progress import Silent
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene, same
from PIL import Image

SMALL = StoreSettings(segment=4096)


def test_arrays_come_back_to_the_bit_in_any_segment(tmp_path):
    store, random = PhotoStore(tmp_path / "new", settings=SMALL), np.random.default_rng(0)
    shapes = [(7, 5, 3), (64, 60), (0, 3), (1,), (33, 41, 3)]
    arrays = [random.integers(0, 255, shape).astype(t) for shape in shapes for t in (np.uint8, np.uint16, np.float32)]
    kept = [store.kept(array) for array in arrays]
    kept.append(store.kept(arrays[0].transpose(1, 0, 2)))
    arrays.append(arrays[0].transpose(1, 0, 2))
    for one, array in zip(kept, arrays, strict=True):
        assert one.dtype == array.dtype and one.shape == array.shape and (one == array).all()
    store.give_back()
    assert all((one == array).all() for one, array in zip(kept, arrays, strict=True))
    assert store.bytes == sum(array.nbytes for array in arrays)
    assert list((tmp_path / "new").iterdir()) == []  # the files have no name
    with pytest.raises(ValueError):
        kept[0][0] = 1


def test_what_is_made_of_a_stored_photo_is_stored_beside_it(tmp_path):
    store = PhotoStore(tmp_path, settings=SMALL)
    photo = store.kept(np.zeros((9, 8, 3), np.uint8))
    made = np.ones((4, 4), np.uint16)
    assert store_of(photo[::2, 1:].transpose(1, 0, 2)) is store and store_of(made) is None
    assert store_of(kept_beside(photo, made)) is store
    assert kept_beside(photo, photo) is photo and kept_beside(np.zeros(3), made) is made


def test_arrays_outlive_the_store(tmp_path):
    photo = PhotoStore(tmp_path, limit=10**12, settings=SMALL).kept(np.arange(5000))
    gc.collect()
    assert (photo == np.arange(5000)).all()


def test_a_full_disk_is_one_line(tmp_path, monkeypatch):
    store = PhotoStore(tmp_path, settings=SMALL)

    class Full:
        def __getattr__(self, name):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(stores.tempfile, "TemporaryFile", lambda **_: Full())
    with pytest.raises(OutputError, match="no space"):
        store.kept(np.zeros(10))


@pytest.mark.skipif(held_bytes() is None, reason="the system does not say what a process holds")
def test_pages_are_given_back_at_the_limit(tmp_path):
    """120 MB are read over and over; the process never holds more than about 40 MB of them."""
    before = held_bytes()
    limit = before + 60_000_000
    store = PhotoStore(tmp_path, limit, StoreSettings(full=(before + 25_000_000) / limit, every=0.002))
    photos = [store.kept(np.full(10_000_000, i, np.uint8)) for i in range(12)]
    most, sums = 0, []
    for i in range(36):
        for start in range(0, 10_000_000, 1_000_000):
            sums.append(int(photos[i % 12][start : start + 1_000_000].sum(dtype=np.int64)))
            most = max(most, held_bytes())
            time.sleep(0.001)
    assert sums == [1_000_000 * (i % 12) for i in range(36) for _ in range(10)]
    assert most - before < 60_000_000
    names = len([t for t in threading.enumerate() if t._target is stores._watch])
    assert names >= 1


def test_loaded_photos_lie_in_the_store(tmp_path):
    random = np.random.default_rng(1)
    for i in range(3):
        alpha = np.full((20, 30, 1), 255, np.uint8)
        alpha[:5] = 0
        pixels = random.integers(0, 255, (20, 30, 3), np.uint8)
        Image.fromarray(np.concatenate([pixels, alpha], axis=2)).save(tmp_path / f"{i}.png")
        (tmp_path / "masks").mkdir(exist_ok=True)
        Image.fromarray(np.where(pixels[:, :, 0] > 99, 255, 0).astype(np.uint8)).save(tmp_path / "masks" / f"{i}.png")
    store = PhotoStore(tmp_path / "store")
    usual = load_photos(tmp_path, None, Silent(), tmp_path / "masks")
    stored = load_photos(tmp_path, None, Silent(), tmp_path / "masks", store=store)
    for a, b in zip(usual, stored, strict=True):
        for name in ("pixels", "alpha", "mask"):
            assert store_of(getattr(b, name)) is store and store_of(getattr(a, name)) is None
            assert (getattr(a, name) == getattr(b, name)).all()


def test_a_training_on_stored_photos_gives_the_same_bits(tmp_path):
    scene, store = blurred_scene(6), PhotoStore(tmp_path)
    mask = np.ones(scene.views[0].photo.shape[:2], bool)
    mask[:20] = False
    views = [replace(view, mask=mask) for view in scene.views]
    stored = [replace(view, photo=store.kept(view.photo), mask=store.kept(mask)) for view in views]
    trained = []
    for some in (views, stored):
        trainer = Trainer(some[1:], some[:1], scene.points, scene.medium, SHORT)
        for step in range(12):
            trainer.advance(step / 12)
        trained.append(trainer.result())
        assert all((store_of(v._photo) is store) == (some is stored) for v in trainer.levels[-1].views)
    assert same(*trained)
