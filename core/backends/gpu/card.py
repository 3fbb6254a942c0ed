"""One graphics card: its memory, its compiled shaders, the orders it is given, and what crosses the bus."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, wraps
from heapq import heappop, heappush
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import DeviceError
from ...warming import finish_warming
from .adapter import adapters, described, refusals
from .layout import GROUPS_ACROSS
from .native import Native
from .shader_text import bindings, shader_text

#: Places for the numbers of one order, and how many there are: the card is asked to begin when they are used up.
_PLACE, _PLACES = 256, 256
#: Orders after which the card begins with them: it works while the next ones are being written. Each time costs
#: the computer a third of a millisecond (counted in software; not yet chosen by times on a card).
_TOGETHER = 32
#: What the card's memory is for, in WebGPU's words.
_USAGE = "STORAGE|COPY_SRC|COPY_DST"
#: Bytes of the buffers that small results are read through.
_STAGING = 4096
#: Bind groups that are kept: making one takes longer than an order.
_GROUPS_KEPT = 2048
#: Freed memory is kept for the next tensor of its size, up to this share of the most that was ever in use: between two
#: steps nearly all of it is free, and to ask the driver for it again takes long. (Less
#: than this, and a step on blurred photos made 46 buffers anew.)
_SPARE = 2.0

Answer = TypeVar("Answer")


@dataclass
class Traffic:
    """What crossed the bus since it was last set to zero: bytes up and down, orders, waits for the card."""

    up: int = 0
    down: int = 0
    orders: int = 0
    waits: int = 0


class Memory:
    """A piece of the card's memory that goes back to the card when nobody holds it."""

    __slots__ = ("buffer", "size", "_card", "_room", "_number")

    def __init__(self, card: Card, buffer: Any, size: int, room: int, number: int) -> None:
        self.buffer, self.size, self._card, self._room, self._number = buffer, size, card, room, number

    def __del__(self) -> None:
        self._card.give_back(self._room, self._number, self.buffer)


def _explained(method: Callable[..., Answer]) -> Callable[..., Answer]:
    """What the driver says in many ways (lost device, no memory) is one typed error."""

    @wraps(method)
    def call(card: Card, *arguments: Any, **named: Any) -> Answer:
        with card.lock:
            try:
                return method(card, *arguments, **named)
            except DeviceError:
                raise
            except card.refusals as error:
                raise card.failed(error) from error

    return call


class Card:
    """Memory and orders of one adapter. Orders are collected, and sent when something is waited for.

    Attributes:
        name: as `doctor` shows it; traffic: see `Traffic`; refusals: what the driver raises.

    Every method raises DeviceError where the card is lost or its memory is used up.
    """

    def __init__(self, adapter: Any) -> None:
        self.refusals = refusals()
        self.name, self.traffic, self.lock = described(adapter), Traffic(), threading.RLock()
        wanted = ("max-buffer-size", "max-storage-buffer-binding-size", "max-storage-buffers-per-shader-stage")
        try:
            self._device = adapter.request_device_sync(required_limits={n: adapter.limits[n] for n in wanted})
        except self.refusals as error:
            raise DeviceError(
                f"The graphics card ({self.name}) cannot be opened: {error}", "Use --device cpu"
            ) from error
        self.largest = min(adapter.limits[n] for n in wanted[:2])
        self._kernels: dict[str, Any] = {}
        self._bound: OrderedDict[tuple[Any, ...], Any] = OrderedDict()
        self._bound_to: dict[Any, set[tuple[Any, ...]]] = {}
        #: Free buffers by size, the oldest first: so every step gets the same ones, and binds them as the last one did;
        #: and when a size was asked for last.
        self._spare: dict[int, list[tuple[int, Any]]] = {}
        self._asked: dict[int, int] = {}
        self._returned: deque[tuple[int, int, Any]] = deque()
        self._made = self._times = 0
        self._in_use = self._most = self._kept = 0
        try:
            self._native, self._sent = Native(self._device), 0
        except (ImportError, AttributeError) as error:  # (its C functions are no promise of wgpu's)
            raise DeviceError(
                f"This wgpu is not the version that the engine was made for ({error})",
                "Install the packages of requirements.txt again; or use --device cpu",
            ) from error
        self._stagings: list[Any] = []
        self._ring = self._device.create_buffer(size=_PLACE * _PLACES, usage="UNIFORM|COPY_DST")
        self._numbers = np.zeros(_PLACE * _PLACES, np.uint8)
        self._written = self._numbers.data
        self._place = 0
        self._encoder: Any = None
        self._pass: Any = None
        #: What orders that were not sent yet are bound to.
        self._waiting: set[tuple[Any, ...]] = set()

    def failed(self, error: Exception) -> DeviceError:
        """What to say when the driver refuses."""
        said = " ".join(str(error).split())[:300]
        return DeviceError(
            f"The graphics card ({self.name}) failed: {said or type(error).__name__}",
            "Go on with --device cpu (--resume takes the last checkpoint); fewer Gaussians or smaller photos need less"
            " of its memory",
        )

    def memory(self, size: int) -> Memory:
        """`size` bytes, whatever stands in them."""
        room = rounded(size)
        with self.lock:
            if self._returned:
                self._sort_returned()
            self._times += 1
            self._asked[room] = self._times
            spare = self._spare.get(room)
            if spare:
                self._kept -= room
                number, buffer = heappop(spare)
            else:
                number, buffer = self._made, self._new_buffer(room)
                self._made += 1
            self._in_use += room
            self._most = max(self._most, self._in_use)
            return Memory(self, buffer, size, room, number)

    @_explained
    def _new_buffer(self, room: int) -> Any:
        """A buffer of the driver's; where there is no room for it, what is kept for later goes first."""
        if room > self.largest:
            raise DeviceError(
                f"The graphics card ({self.name}) takes no more than {self.largest / 1e6:.0f} MB in one piece, and"
                f" {room / 1e6:.0f} are needed",
                "Train fewer Gaussians (--max-gaussians) or smaller photos (--max-size), or use --device cpu",
            )
        try:
            return self._device.create_buffer(size=room, usage=_USAGE)
        except self.refusals:
            if not self._kept:
                raise
        self.send()  # (orders that wait may still need what is let go)
        while self._kept:
            self._let_go()
        return self._device.create_buffer(size=room, usage=_USAGE)

    def give_back(self, room: int, number: int, buffer: Any) -> None:
        """Takes a buffer of `room` bytes that nobody holds any more; never waits.

        Python may call this in any thread, that of the driver included, while another one holds the lock and waits
        for the driver.
        """
        self._returned.append((room, number, buffer))

    def _sort_returned(self) -> None:
        """Keeps returned buffers for the next one of their size; lets go of those not used longest."""
        while self._returned:
            room, number, buffer = self._returned.popleft()
            self._in_use -= room
            self._kept += room
            heappush(self._spare.setdefault(room, []), (number, buffer))
        while self._kept > _SPARE * self._most:
            self._let_go()

    def _let_go(self) -> None:
        """Frees one of the buffers whose size was not asked for for longest."""
        size = min((room for room, spare in self._spare.items() if spare), key=lambda room: self._asked[room])
        gone = self._spare[size].pop()[1]  # (a heap without its last is one)
        self._kept -= size
        for key in self._bound_to.pop(id(gone), ()):
            self._bound.pop(key, None)

    @_explained
    def write(self, memory: Memory, values: NDArray[Any]) -> None:
        """Copies an array to the card."""
        raw = np.ascontiguousarray(values).reshape(-1).view(np.uint8)
        if not raw.size:
            return
        if any(id(memory.buffer) in key for key in self._waiting):  # orders that wait still need what stands there
            self.send()
        if raw.size % 4:
            raw = np.concatenate([raw, np.zeros(-raw.size % 4, np.uint8)])
        self._device.queue.write_buffer(memory.buffer, 0, raw)
        self.traffic.up += raw.size

    def read(self, memory: Memory, size: int, offset: int = 0) -> NDArray[np.uint8]:
        """[size] bytes from the card; waits for all that was ordered."""
        return self.fetch(memory, size, offset)()

    @_explained
    def fetch(self, memory: Memory, size: int, offset: int = 0) -> Callable[[], NDArray[np.uint8]]:
        """Asks for bytes as they are after all that was ordered so far; who calls the result waits for them.

        In the meantime more can be ordered. Every result is called once.
        """
        if not size:
            return lambda: np.empty(0, np.uint8)
        whole = -(-size // 4) * 4
        staging = self._stagings.pop() if whole <= _STAGING and self._stagings else self._new_staging(whole)
        self._end_pass()
        self._native.copy(self._recording(), memory.buffer, offset, staging, 0, whole)
        self.send()
        question, sent = self._native.ask(staging, whole), self._sent
        return lambda: self._arrived(staging, size, question, sent)

    @_explained
    def _arrived(self, staging: Any, size: int, question: int, sent: int) -> NDArray[np.uint8]:
        raw = self._native.answer(staging, -(-size // 4) * 4, question, sent)
        if staging.size == _STAGING:
            self._stagings.append(staging)
        else:
            staging.destroy()
        self.traffic.down += size
        self.traffic.waits += 1
        return np.frombuffer(raw, np.uint8)[:size]

    def _new_staging(self, size: int) -> Any:
        """A buffer that the computer can read; small ones are of one size, and used again."""
        return self._device.create_buffer(size=max(size, _STAGING), usage="MAP_READ|COPY_DST")

    @_explained
    def run(self, kernel: str, groups: tuple[int, int], numbers: bytes, *memories: Memory) -> None:
        """Orders a shader.

        Args:
            groups: across and down; numbers: what it binds as its uniform; memories: its other bindings, in order.
        """
        if not groups[0] or not groups[1]:
            return
        if self._place == _PLACES:
            self.send()
        at = self._place * _PLACE
        self._written[at : at + len(numbers)] = numbers
        self._place += 1
        if self._pass is None:
            self._pass = self._native.begin(self._recording())
        self._native.order(self._pass, *self._bound_for(kernel, memories), at, groups)
        self.traffic.orders += 1
        if self._place % _TOGETHER == 0:
            self.send()

    def for_each(self, kernel: str, count: int, per_group: int, numbers: bytes, *memories: Memory) -> None:
        """Orders a shader for `count` items, `per_group` of them to a group."""
        groups = -(-count // per_group)
        across = min(groups, GROUPS_ACROSS)
        self.run(kernel, (across, -(-groups // across) if across else 0), numbers, *memories)

    @_explained
    def clear(self, memory: Memory) -> None:
        """Sets memory to zero."""
        self._end_pass()
        self._native.clear(self._recording(), memory.buffer)
        self._waiting.add((id(memory.buffer),))

    @_explained
    def copy(self, source: Memory, target: Memory, size: int, source_offset: int = 0, target_offset: int = 0) -> None:
        """Copies bytes on the card; sizes and offsets are multiples of 4."""
        if not size:
            return
        self._end_pass()
        self._native.copy(self._recording(), source.buffer, source_offset, target.buffer, target_offset, size)
        self._waiting.add((id(source.buffer), id(target.buffer)))

    @_explained
    def send(self) -> None:
        """Lets the card begin with what was ordered."""
        if self._encoder is None:
            return
        self._end_pass()
        if self._place:
            self._native.write(self._ring, self._numbers, self._place * _PLACE)
        orders, self._encoder = self._encoder, None
        self._place = 0
        self._waiting.clear()
        self._sent = self._native.submit(orders)

    @_explained
    def wait(self) -> None:
        """Waits until all that was ordered is done."""
        self.send()
        self._native.wait()

    @_explained
    def compile(self, kernel: str) -> None:
        """Makes a shader ready that will be ordered."""
        if kernel not in self._kernels:
            self._compiled(kernel)

    def _recording(self) -> Any:
        if self._encoder is None:
            self._encoder = self._native.encoder()
        return self._encoder

    def _end_pass(self) -> None:
        if self._pass is not None:
            self._native.end(self._pass)
            self._pass = None

    def _compiled(self, kernel: str) -> tuple[Any, Any]:
        device, kinds = self._device, {"storage, read": "read-only-storage", "storage, read_write": "storage"}
        entries = [
            {
                "binding": number,
                "visibility": 4,  # compute
                "buffer": {"type": "uniform", "has_dynamic_offset": True}
                if kind == "uniform"
                else {"type": kinds[kind]},
            }
            for number, kind in enumerate(bindings(kernel))
        ]
        layout = device.create_bind_group_layout(entries=entries)
        pipeline = device.create_compute_pipeline(
            layout=device.create_pipeline_layout(bind_group_layouts=[layout]),
            compute={"module": device.create_shader_module(code=shader_text(kernel)), "entry_point": "main"},
        )
        self._kernels[kernel] = pipeline, layout
        return pipeline, layout

    def _bound_for(self, kernel: str, memories: Sequence[Memory]) -> tuple[Any, Any]:
        """A compiled shader, and its bindings to these memories."""
        key = (kernel, *[id(memory.buffer) for memory in memories])
        self._waiting.add(key)
        found = self._bound.get(key)
        if found is None:
            found = self._bound[key] = self._newly_bound(kernel, [memory.buffer for memory in memories])
            for number in key[1:]:
                self._bound_to.setdefault(number, set()).add(key)
            if len(self._bound) > _GROUPS_KEPT:
                self._bound.popitem(last=False)
        else:
            self._bound.move_to_end(key)
        return found[0], found[1]

    def _newly_bound(self, kernel: str, buffers: list[Any]) -> tuple[Any, Any, list[Any]]:
        """The shader, its bindings, and the buffers, which it holds, so that no others can get their ids."""
        pipeline, layout = self._kernels.get(kernel) or self._compiled(kernel)
        bound = [(self._ring, _PLACE), *((buffer, buffer.size) for buffer in buffers)]
        entries = [
            {"binding": number, "resource": {"buffer": buffer, "offset": 0, "size": size}}
            for number, (buffer, size) in enumerate(bound)
        ]
        return pipeline, self._device.create_bind_group(layout=layout, entries=entries), buffers


@cache
def rounded(size: int) -> int:
    """Bytes that are taken for `size`: an eighth more at most, so that memory fits again when a few Gaussians come."""
    step = max(256, 1 << max(0, size.bit_length() - 4))
    return -(-max(size, 4) // step) * step


def card() -> Card:
    """The best card of this machine; software where there is nothing else. Where it is being made ready, it is waited
    for: two threads do not use it at the same time.

    Raises:
        DeviceError: there is none, or it cannot be opened.
    """
    finish_warming()
    return _opened()


@cache
def _opened() -> Card:
    return Card(adapters()[0])
