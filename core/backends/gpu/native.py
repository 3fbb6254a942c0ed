"""What a step asks of the driver many times, by wgpu's C functions.

Its Python methods ask for errors after every word, and to wait for bytes they keep a second thread polling: an order
takes three times as long then, and a read as long as twenty orders.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

#: Times that the driver is asked whether bytes have come, after it said that all before them was done.
_PATIENCE = 1000


class Native:
    """The driver's side of one device. What it refuses is raised, by every method but `order`."""

    def __init__(self, device: Any) -> None:
        self._device, wgpu = device, import_module("wgpu.backends.wgpu_native")
        self._plain, self._ffi = wgpu.lib, wgpu.ffi
        self._safe = import_module("wgpu.backends.wgpu_native._api").libf
        self._place = self._ffi.new("uint32_t []", 1)
        self._orders = self._ffi.new("WGPUCommandBuffer []", 1)
        self._submission = self._ffi.new("WGPUSubmissionIndex *")
        self._asked, self._answers = 0, {}  # type: ignore[var-annotated]

        def answered(status: int, _message: Any, number: Any, _nothing: Any) -> None:
            self._answers[int(self._ffi.cast("intptr_t", number))] = status

        kind = "void(WGPUMapAsyncStatus, WGPUStringView, void *, void *)"
        self._answered = self._ffi.callback(kind, answered)

    def order(self, begun: Any, pipeline: Any, bound: Any, place: int, groups: Sequence[int]) -> None:
        """One shader of a pass that has begun, its uniform at `place`; what is wrong is raised when it is sent."""
        here = begun._internal
        self._place[0] = place
        self._plain.wgpuComputePassEncoderSetPipeline(here, pipeline._internal)
        self._plain.wgpuComputePassEncoderSetBindGroup(here, 0, bound._internal, 1, self._place)
        self._plain.wgpuComputePassEncoderDispatchWorkgroups(here, *groups, 1)

    def submit(self, orders: Any) -> int:
        """Gives a command buffer to the card; its number."""
        self._orders[0] = orders._internal
        return int(self._safe.wgpuQueueSubmitForIndex(self._device.queue._internal, 1, self._orders))

    def wait(self, submission: int | None = None) -> None:
        """Waits until a submission, or all, and what came before, is done."""
        if submission is not None:
            self._submission[0] = submission
        until = self._ffi.NULL if submission is None else self._submission
        self._safe.wgpuDevicePoll(self._device._internal, True, until)

    def ask(self, staging: Any, size: int) -> int:
        """Asks for bytes of a buffer that can be mapped, once all that was submitted is done; the question's number."""
        self._asked += 1
        info = self._ffi.new("WGPUBufferMapCallbackInfo *")
        info.mode, info.callback = self._plain.WGPUCallbackMode_AllowProcessEvents, self._answered
        info.userdata1 = self._ffi.cast("void *", self._asked)
        self._safe.wgpuBufferMapAsync(staging._internal, self._plain.WGPUMapMode_Read, 0, size, info[0])
        return self._asked

    def answer(self, staging: Any, size: int, question: int, submission: int) -> bytes:
        """The bytes; waits for them.

        Raises:
            RuntimeError: they do not come: the device is lost.
        """
        for _ in range(_PATIENCE):
            self.wait(submission)
            if question in self._answers:
                break
        status = self._answers.pop(question, None)
        if status != self._plain.WGPUMapAsyncStatus_Success:
            raise RuntimeError(f"what was computed cannot be read ({status})")
        seen = self._safe.wgpuBufferGetConstMappedRange(staging._internal, 0, size)
        found = bytes(self._ffi.buffer(seen, size))
        self._safe.wgpuBufferUnmap(staging._internal)
        return found
