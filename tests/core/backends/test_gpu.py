"""The graphics card's back end beyond what all rasterizers share: what is said where there is none, the same bits every
time, torch's operations on its tensors, and that nobody pays for a card who has none."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import torch
from dgs.core.backends.gpu import adapter, sorting
from dgs.core.backends.gpu.layout import SCAN_GROUP, SORT_RUN
from dgs.core.backends.gpu.shader_text import bindings, constants_text, shader_text
from dgs.core.backends.gpu.sorting import prefix_sums, sort
from dgs.core.constants import LOG_SCALE_LIMIT, SH_C2, TRANSMITTANCE_STOP
from dgs.core.devices import AdamStep, backend_named, choose_device, tensors_on
from dgs.core.errors import DeviceError
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.training.density.contribution import seen_by
from dgs.studies.stability.scenes import drawn, make_camera, random_scene
from dgs.tests.back_ends import brought_up, or_skip

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def card():
    or_skip("gpu")
    from dgs.core.backends.gpu.card import card

    return card()


def test_auto_loads_nothing_for_a_card():
    """Not even where a driver stands in for one: software is no card."""
    if adapter.may_have_card():
        pytest.skip("there is a graphics device to be looked at")
    code = (
        "import run_dgs, sys; run_dgs.mount_package(); from dgs.core.devices import choose_device, quick_devices;"
        " assert choose_device('auto') == 'cpu' and quick_devices() == (); sys.exit('wgpu' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_without_wgpu_the_way_out_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "wgpu", None)
    adapter.adapters.cache_clear()
    try:
        with pytest.raises(DeviceError, match=r"pip install wgpu.*--device cpu"):
            adapter.adapters()
    finally:
        adapter.adapters.cache_clear()


def test_without_an_adapter_the_way_out_is_named(monkeypatch):
    wgpu = pytest.importorskip("wgpu")
    pytest.importorskip("wgpu.backends.wgpu_native")  # (which puts its own functions into wgpu.gpu)
    monkeypatch.setattr(wgpu.gpu, "enumerate_adapters_sync", list)
    adapter.adapters.cache_clear()
    try:
        with pytest.raises(DeviceError, match=r"No graphics card.*--device cpu"):
            adapter.adapters()
    finally:
        adapter.adapters.cache_clear()


def test_another_wgpu_is_named(card, monkeypatch):
    """Its C functions may have other names from one version to the next."""

    def other(device):
        raise AttributeError("wgpuQueueSubmitForIndex")

    monkeypatch.setattr("dgs.core.backends.gpu.card.Native", other)
    with pytest.raises(DeviceError, match=r"not the version.*requirements.txt"):
        type(card)(adapter.adapters()[0])


def test_shaders_take_their_numbers_from_python():
    text = constants_text()
    assert f"const TRANSMITTANCE_STOP = {TRANSMITTANCE_STOP!r};" in text and f"const SH_C2_4 = {SH_C2[4]!r};" in text
    folder = Path(adapter.__file__).parent / "shaders"
    mains = [file.stem for file in folder.glob("*.wgsl") if "fn main" in file.read_text("utf-8")]
    assert len(mains) > 8
    for name in mains:
        assert bindings(name)[0] == "uniform" and text in shader_text(name), name


def test_the_same_bits_every_time(card):
    scene, camera = random_scene(800, 1, seed=1), make_camera(150, 110, 120.0)
    first = drawn(scene, camera, "gpu")
    for _ in range(2):
        found = drawn(scene, camera, "gpu")
        assert torch.equal(found.image, first.image) and torch.equal(found.alpha, first.alpha)
        for name, gradient in first.gradients.items():
            assert torch.equal(found.gradients[name], gradient), name


#: Keys that a group sorts at once: sizes around it and its multiples are where sorting and sums could go wrong.
TILE_KEYS = SCAN_GROUP * SORT_RUN


def on_card(card, values, room=0):
    """A piece of the card's memory with uint32 in it, and room for more of them."""
    memory = card.memory(4 * (len(values) + room))
    card.write(memory, values.astype(np.uint32))
    return memory


def sorted_on_card(card, keys, bits, *, numbered=False):
    """Keys and values, which are the keys' old places, as the card sorts them."""
    values = None if numbered else on_card(card, np.arange(len(keys)))
    found = sort(card, on_card(card, keys), values, len(keys), bits)
    return [card.read(memory, 4 * len(keys)).view(np.uint32) for memory in found]


def assert_sorted(card, keys, bits, *, numbered=False):
    """As numpy's stable sort by the lowest bits."""
    order = np.argsort(keys & np.uint32((1 << bits) - 1), kind="stable")
    found = sorted_on_card(card, keys, bits, numbered=numbered)
    assert (found[1] == order).all() and (found[0] == keys[order]).all()


@pytest.mark.parametrize("count", [0, 1, 5, TILE_KEYS - 1, TILE_KEYS, TILE_KEYS + 1, 5001, 300_007])
def test_sorting_is_numpy_s(card, count):
    random = np.random.default_rng(count)
    assert_sorted(card, random.integers(0, 2**32, count, dtype=np.uint32), 32)
    few = random.integers(0, 3, count, dtype=np.uint32)
    assert_sorted(card, few * np.uint32(0x55555555), 11, numbered=True)


@pytest.mark.parametrize("bits", range(1, 33))
def test_sorting_by_any_number_of_bits(card, bits):
    """By the lowest ones; those above are only carried along."""
    keys = np.random.default_rng(bits).integers(0, 2**32, 2 * TILE_KEYS + 77, dtype=np.uint32)
    assert_sorted(card, keys, bits, numbered=bits % 2 == 0)


@pytest.mark.parametrize("key", [0, 1, 0x80000000, 0xFFFFFFFF])
def test_equal_keys_keep_their_order(card, key):
    assert_sorted(card, np.full(3 * TILE_KEYS + 1, key, np.uint32), 32)


def test_sorting_keeps_what_is_in_order_and_turns_what_is_not(card):
    ascending = np.arange(3 * TILE_KEYS + 1, dtype=np.uint32)
    for keys in (ascending, ascending[::-1], (ascending << 22) | (ascending >> 10)):
        assert_sorted(card, keys.copy(), 32)


@pytest.mark.parametrize("chunks", [1, 2, 3])
def test_chunks_of_many_tiles(card, monkeypatch, chunks):
    """As millions of values have them."""
    monkeypatch.setattr(sorting, "SORT_CHUNKS", chunks)
    monkeypatch.setattr(sorting, "SCAN_CHUNKS", chunks)
    random = np.random.default_rng(chunks)
    for count in (2 * chunks * TILE_KEYS, 2 * chunks * TILE_KEYS + 1, 4 * TILE_KEYS - 1):
        keys = random.integers(0, 2**32, count, dtype=np.uint32)
        assert_sorted(card, keys, 32)
        assert_sorted(card, keys >> 20, 12)
        assert_sums(card, keys & 255)


def assert_sums(card, values):
    """As numpy's, those that are more than 32 bits cut off alike."""
    table = on_card(card, values, room=1)
    prefix_sums(card, table, len(values))
    found = card.read(table, 4 * (len(values) + 1)).view(np.uint32)
    assert (found == np.concatenate([[0], np.cumsum(values, dtype=np.uint32)])).all()


@pytest.mark.parametrize("count", [0, 1, 5, TILE_KEYS - 1, TILE_KEYS, TILE_KEYS + 1, 5001, 300_007, 2_500_000])
def test_prefix_sums_are_numpy_s(card, count):
    values = np.random.default_rng(count).integers(0, 2**32 if count == 5001 else 200, count, dtype=np.uint32)
    assert_sums(card, values)


def test_memory_for_sorting_need_not_begin_as_zeros(card, monkeypatch):
    given = card.memory

    def used_before(size):
        memory = given(size)
        card.write(memory, np.full(-(-size // 4), 0xABCDEF01, np.uint32))
        return memory

    monkeypatch.setattr(card, "memory", used_before)
    keys = np.random.default_rng(0).integers(0, 2**32, 3 * TILE_KEYS + 1, dtype=np.uint32)
    for bits in (8, 11, 24, 32):
        assert_sorted(card, keys, bits, numbered=True)
    assert_sums(card, keys)


def test_how_many_orders_sorting_takes(card):
    """An order costs a processor's time whatever it does."""
    keys = np.arange(5000, dtype=np.uint32)
    for bits, wanted in ((8, 2), (11, 3), (16, 3), (32, 5)):
        card.traffic.orders = 0
        sort(card, on_card(card, keys), None, len(keys), bits)
        assert card.traffic.orders == wanted
    for count, wanted in ((TILE_KEYS, 1), (5000, 2)):
        card.traffic.orders = 0
        prefix_sums(card, on_card(card, keys, room=1), count)
        assert card.traffic.orders == wanted


def test_torch_s_operations_on_the_card_s_tensors(card):
    """Views share what they show, whoever writes it; what is made from nothing lies on the card."""
    from dgs.core.backends.gpu.tensors import CardTensor

    frame = torch.zeros(3, 4, device="gpu")
    frame[1:, 1:3] += 2.0
    frame[0] = torch.arange(4.0)
    wanted = torch.tensor([[0.0, 1, 2, 3], [0, 2, 2, 0], [0, 2, 2, 0]])
    assert isinstance(frame, CardTensor) and torch.equal(frame.cpu(), wanted)
    assert torch.equal((frame.t() @ frame).cpu(), wanted.t() @ wanted)
    assert torch.equal(frame[frame > 1].cpu(), wanted[wanted > 1]) and frame.sum().item() == float(wanted.sum())
    made = (torch.ones(2, device="gpu"), torch.tensor([1.0, 1.0], device="gpu"), torch.ones(2).to("gpu"))
    assert all(isinstance(one, CardTensor) and one.tolist() == [1.0, 1.0] for one in made)
    leaf = torch.ones(3).to("gpu").requires_grad_()
    (leaf[:2] * leaf[1:]).sum().backward()
    assert leaf.grad is not None and leaf.grad.tolist() == [1.0, 2.0, 1.0]
    with pytest.raises((TypeError, RuntimeError)):  # (as of every tensor that is not in the computer's memory)
        leaf.detach().numpy()


def test_what_was_drawn_stays_on_the_card(card):
    """A second view of the same Gaussians brings nothing up, and down only how many pairs and culled ones there are."""
    scene, camera = random_scene(200, 1).to(device="gpu"), make_camera()
    render(scene, camera)
    card.traffic.up = card.traffic.down = 0
    render(scene, camera)
    assert card.traffic.up == 0 and card.traffic.down <= 64


#: Division as a card does it: a reciprocal beyond 2^126 is flushed to zero.
RECIPROCAL = """
fn reciprocal(x: f32) -> f32 { return select(0.0, 1.0 / x, abs(x) < 0x1p+126); }
"""


@pytest.mark.parametrize("huge", [3.4e38, -3.4e38, 1e38])
def test_a_huge_quaternion_has_a_direction_on_every_card(card, monkeypatch, huge):
    """Software divides by everything; the first real card found none, and a gradient that was no number."""
    from dgs.core.backends.gpu import card as module

    def as_a_card(name):
        text = shader_text(name)
        for part in ("max(tame * s.largest, 1e-30)", "max(s.length, 1e-30)", "s.largest", "max(s.length, 1.0)"):
            text = text.replace(f"/ {part}", f"* reciprocal({part})")
        return text + RECIPROCAL

    scene, camera = random_scene(12, 1, seed=1), make_camera()
    scene.quaternions[0, 2] = huge
    wanted = drawn(scene, camera, "gpu")
    assert as_a_card("project").count("* reciprocal") == 3 and as_a_card("project_backward").count("* reciprocal") == 4
    monkeypatch.setattr(module, "shader_text", as_a_card)
    monkeypatch.setattr(card, "_kernels", {})
    found = drawn(scene, camera, "gpu")
    assert found.finite and found.view.screen.culled == wanted.view.screen.culled
    torch.testing.assert_close(found.image, wanted.image, rtol=1e-5, atol=1e-5)


def test_gaussians_elsewhere_are_refused(card):
    with pytest.raises(DeviceError, match="Move them"):
        render(random_scene(3), make_camera(), backend="gpu")
    with pytest.raises(DeviceError, match="float64"):
        render(random_scene(3).to(device="gpu", dtype=torch.float64), make_camera(), backend="gpu")


def test_more_than_the_card_takes_is_one_line(card):
    with pytest.raises(DeviceError, match=r"takes no more than \d+ MB.*--max-gaussians"):
        card.memory(1 << 40)


def test_asked_by_name_it_is_taken(card):
    assert choose_device("gpu") == "gpu" and tensors_on("gpu") == "gpu"
    backend_named("gpu").synchronize()


def test_a_lost_card_is_one_line():
    """In a process of its own: the card is gone for good."""
    or_skip("gpu")
    code = """
import run_dgs; run_dgs.mount_package()
from dgs.core.backends.gpu.card import card
from dgs.core.devices import choose_device
from dgs.core.errors import DeviceError
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.training.density.contribution import seen_by
from dgs.studies.stability.scenes import make_camera, random_scene
choose_device("gpu")
scene = random_scene(20).to(device="gpu")
render(scene, make_camera())
card()._device.destroy()
try:
    render(scene, make_camera()).image.cpu()
except DeviceError as error:
    assert "failed" in str(error) and "--device cpu" in error.way_out, error
    raise SystemExit(7)
"""
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False, capture_output=True, text=True)
    assert run.returncode == 7, run.stderr[-2000:]


@pytest.mark.parametrize("antialias", [False, True])
def test_what_a_photo_sees_is_the_reference_s(card, antialias):
    """Some lie outside the frame, some behind the camera, some behind others; a part of the px counts less."""
    scene, settings = random_scene(300, 1, seed=4), RasterSettings(antialias=antialias)
    scene.means[:20, 2] -= 9.0
    cameras = [make_camera(), make_camera()]
    weight = torch.linspace(0.2, 1.0, cameras[0].height)[:, None].expand(-1, cameras[0].width)
    for weights in ((None, None), (None, weight)):
        theirs = seen_by(scene, zip(cameras, weights, strict=True), settings)
        there = [None if one is None else one.to("gpu") for one in weights]
        ours = seen_by(scene.to(device="gpu"), zip(cameras, there, strict=True), settings)
        for one, other in zip(ours.sums(), theirs.sums(), strict=True):
            torch.testing.assert_close(one.cpu(), other, rtol=1e-4, atol=1e-4)
        assert 0 < float(theirs.framed.sum()) < 2 * len(scene)


def test_the_check_of_parameters_is_the_reference_s(card):
    """Nobody is larger than its distance allows afterwards; who has a number that is none is left as it is."""
    plain, centres = random_scene(200, 1, seed=2), torch.tensor([[0.0, 0.0, -3.0], [1.0, 0.5, -2.0]])
    plain.log_scales[3:9] = torch.linspace(0.5, 4.0, 6)[:, None]
    plain.log_scales[12, 1] = -2 * LOG_SCALE_LIMIT
    ours, theirs = plain.to(device="gpu"), plain.detached()
    found, wanted = (
        backend_named(name).guard(one, centres.to(one.means.device))
        for name, one in (("gpu", ours), ("reference", theirs))
    )
    assert found == wanted and wanted.limited >= 6 and wanted.clamped == 1 and not wanted.broken
    torch.testing.assert_close(ours.log_scales.cpu(), theirs.log_scales)
    for name, value in (("sh", torch.nan), ("means", torch.inf), ("log_scales", torch.nan)):
        bad = plain.detached()
        getattr(bad, name)[5, 0] = value
        bad = bad.to(device="gpu")
        assert backend_named("gpu").guard(bad, centres.to("gpu")).broken, name
        kept = bad.log_scales.cpu()[5]
        torch.testing.assert_close(kept[1:], plain.log_scales[5, 1:])


def test_losses_and_adam_are_the_reference_s(card):
    drawn = torch.rand(2, 3, 37, 50, generator=torch.Generator().manual_seed(0))
    image, photo = drawn[0], 0.7 * drawn[0] + 0.3 * drawn[1]
    photo[:, :12, :12] = image[:, :12, :12] = 0.25  # flat, and equal
    ours, theirs = backend_named("gpu"), backend_named("reference")
    value, slope = ours.photometric(image.to("gpu"), photo.to("gpu"), None, 0.2)
    wanted, slope_wanted = theirs.photometric(image.double(), photo.double(), None, 0.2)
    assert float(value) == pytest.approx(wanted, rel=1e-5)
    torch.testing.assert_close(slope.cpu().double(), slope_wanted, rtol=1e-3, atol=2e-8)
    photo[0, 5, 5] = torch.nan
    value, slope = ours.photometric(image.to("gpu"), photo.to("gpu"), None, 0.2)
    assert float(value) == pytest.approx(theirs.photometric(image, photo, None, 0.2)[0], rel=1e-4)
    assert slope[0, 5, 5].item() == 0.0
    for knee in (0.1, float("inf")):
        found = ours.variation_gradient(image.to("gpu"), knee)
        torch.testing.assert_close(found.cpu(), theirs.variation_gradient(image, knee), rtol=1e-4, atol=1e-5)
    specks = ours.speck_gradient(image.to("gpu")).cpu()
    torch.testing.assert_close(specks, theirs.speck_gradient(image), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("leading", [None, 3])
def test_its_step_of_adam_is_the_reference_s(card, leading):
    drawn = torch.randn(3, 50, 4, 3, generator=torch.Generator().manual_seed(0))
    found = []
    for name in ("gpu", "reference"):
        values, gradient, first = (t.clone().to(tensors_on(name)) for t in drawn)
        gradient[7, 1, 2] = torch.nan
        numbers, refused = (
            (0.1, 0.01, leading, 1.5, (0.9, 0.999), 1e-15),
            torch.ones(1, dtype=torch.int32).to(tensors_on(name)),
        )
        step = AdamStep(values, gradient, first, first.square(), *numbers, refused)
        backend_named(name).adam([step])
        assert int(step.refused) == 2  # (added to what was there)
        found.append((step.values.cpu(), step.first.cpu(), step.second.cpu()))
    for ours, theirs in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)


def test_sums_and_products_on_the_card(card):
    """Each as torch's own, and nothing crosses the bus."""
    plain = torch.rand(2, 3, 5, 7, generator=torch.Generator().manual_seed(0))
    a, b = (brought_up(one) for one in plain)
    card.traffic.up = card.traffic.down = 0
    found = [1.0 - a, a * 2.0, a * b, a + b, a - b, a + 3.0, torch.zeros_like(a)]
    total = a.clone()
    total += b
    assert card.traffic.up == 0 and card.traffic.down == 0
    one, other = plain
    wanted = [1.0 - one, one * 2.0, one * other, one + other, one - other, one + 3.0, torch.zeros_like(one)]
    for ours, theirs in zip((*found, total), (*wanted, one + other), strict=True):
        torch.testing.assert_close(ours.cpu(), theirs)


#: What is done with tensors of the card, as torch does it: a, b [3, 5, 7], row [7], mask [5, 7], spectrum [3, 5, 4].
OPERATIONS = {
    "broadcast": lambda a, b, row, mask, s: a * row + row / 2 - b,
    "divided": lambda a, b, row, mask, s: 1.0 / (a + 1.0) / b.clamp(min=0.1),
    "limited": lambda a, b, row, mask, s: torch.maximum(a.clamp(0.2, 0.7), torch.minimum(b, row)),
    "powers": lambda a, b, row, mask, s: a.square() + a**2.4 + b.sqrt() + (b - 0.5).abs() + (b - 0.5).sign(),
    "exponentials": lambda a, b, row, mask, s: a.exp() + torch.sigmoid(4 * b - 2) - (-a),
    "where": lambda a, b, row, mask, s: torch.where(mask & (a > 0.3), a, torch.where(~mask | (b <= 0.5), b, 0.5)),
    "truths": lambda a, b, row, mask, s: (mask * (a >= b) * a.isfinite()).to(torch.float32) + (a < row) * 2.0,
    "sums": lambda a, b, row, mask, s: a.sum(dim=1)[:, None] + b.mean(dim=(1, 2), keepdim=True) + (a + b).mean(),
    "lengths": lambda a, b, row, mask, s: (a - b).norm(dim=2) + a.amax(dim=-1),
    "matrices": lambda a, b, row, mask, s: (a.transpose(1, 2) @ b) @ a[0, :3].T,
    "slices": lambda a, b, row, mask, s: a[:, 1:4, 2:].contiguous() * b[:, :3, :5],
    "stacked": lambda a, b, row, mask, s: torch.stack([a, a + b, b])[1:],
    "rows": lambda a, b, row, mask, s: torch.cat([a[torch.tensor([2, 0, 2, 1])], b])[torch.tensor([-1, 0])],
    "pads": lambda a, b, row, mask, s: torch.nn.functional.pad(a[:, 1:], (2, -1, 0, 3), value=0.5),
    "spectra": lambda a, b, row, mask, s: torch.fft.irfft2(
        (s * s.conj() * a[:, :, :4] + s).sum(dim=0) / 3.0 + s - s[0], s=(5, 6)
    ),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_torch_s_operations_on_values_on_the_card(card, name):
    """Each as torch's own, and nothing crosses the bus but the numbers of rows."""
    plain = torch.rand(2, 3, 5, 7, generator=torch.Generator().manual_seed(0))
    given = [*plain, plain[0, 0, 0], plain[1, 1] > 0.4, torch.fft.rfft2(plain[0, :, :, :6])]
    ours = [brought_up(one) for one in given]
    OPERATIONS[name](*ours)
    card.traffic.up = card.traffic.down = 0
    found = OPERATIONS[name](*ours)
    assert card.traffic.up <= 24 and card.traffic.down == 0 and found.held.only_on_card
    torch.testing.assert_close(found.cpu(), OPERATIONS[name](*given), rtol=2e-5, atol=1e-5)


def test_a_part_is_changed_on_the_card(card):
    plain = torch.rand(3, 6, 8, generator=torch.Generator().manual_seed(0))
    found, wanted = brought_up(plain), plain.clone()
    other = brought_up(plain[:, 2:, 3:])
    card.traffic.up = card.traffic.down = 0
    for whole, part in ((found, other), (wanted, plain[:, 2:, 3:])):
        whole[:, :4, 1:6] -= 0.3 * part
        whole[0] *= 2.0
        whole[1:, 5:] = part[:2, :1, :1]
        whole /= 1.5
        whole[1].neg_()
    assert card.traffic.up == 0 and card.traffic.down == 0
    torch.testing.assert_close(found.cpu(), wanted)


def test_what_is_not_finite_is_seen_on_the_card(card):
    plain = torch.tensor([0.0, torch.nan, torch.inf, -torch.inf, 1.0, -1.0, 3e38])
    ours = brought_up(plain)
    for found, wanted in (
        (ours.isfinite(), plain.isfinite()),
        (ours.isnan(), plain.isnan()),
        (ours > 0.5, plain > 0.5),
        (ours <= 0.5, plain <= 0.5),
        (torch.where(ours.isfinite(), ours, 0.0), torch.where(plain.isfinite(), plain, 0.0)),
    ):
        assert torch.equal(found.cpu(), wanted)


def test_memory_goes_back_while_another_thread_waits_for_the_card(card):
    """Python may let go of tensors in the driver's thread, which the one that holds the lock waits for."""
    held = [card.memory(64)]
    gone = threading.Thread(target=held.clear, daemon=True)
    with card.lock:
        gone.start()
        gone.join(timeout=5.0)
        assert not gone.is_alive()


def test_a_step_asks_for_no_new_memory(card):
    """The same orders get the same memory, and so nothing has to be bound anew."""
    scene = random_scene(300, 1, seed=5)
    for _ in range(3):
        drawn(scene, make_camera(), "gpu")
    before = card._made, set(card._bound)
    drawn(scene, make_camera(), "gpu")
    assert (card._made, set(card._bound)) == before


def test_what_is_kept_goes_where_the_driver_has_no_more(card, monkeypatch):
    held = card.memory(1 << 20)
    del held
    card._sort_returned()
    refusing, made = [True], card._device.create_buffer

    def create(**asked):
        if refusing:
            refusing.clear()
            raise RuntimeError("out of memory")
        return made(**asked)

    monkeypatch.setattr(card._device, "create_buffer", create)
    assert card.memory(12345 << 8).buffer.size >= 12345 << 8
    assert not any(card._spare.values()) and not card._kept


def test_memory_goes_back_to_the_card(card):
    """Sizes change whenever Gaussians come and go: what is kept of the old ones is bounded, and nothing else is."""
    from dgs.core.backends.gpu.card import _SPARE, rounded

    assert [rounded(n) for n in (0, 4, 257, 5000, 1 << 20)] == [256, 256, 512, 5120, 1 << 20]
    for count in range(100, 1600, 50):
        scene = random_scene(count, 1, seed=count)
        drawn(scene, make_camera(), "gpu")
    card._sort_returned()
    assert 0 < card._kept <= _SPARE * card._most
    alive = {id(buffer) for spare in card._spare.values() for _, buffer in spare}
    assert sum(size * len(spare) for size, spare in card._spare.items()) == card._kept
    bound = {number for key in card._bound for number in key[1:]}
    assert len(bound - alive) < 60  # those in use now
