"""What a step asks of the driver many times, by wgpu's C functions.

Its Python methods ask for errors after every word, and to wait for bytes they keep a second thread polling: an order
takes three times as long then, and a read as long as twenty orders.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Times that the driver is asked whether bytes have come, after it said that all before them was done.
_PATIENCE = 1000


class Native:
    """The driver's side of one device. What it refuses is raised by `submit`, `wait`, `ask` and `answer`."""

    def __init__(self, device: Any) -> None:
        self._device, wgpu = device, import_module("wgpu.backends.wgpu_native")
        self._plain, self._ffi, self._nothing = wgpu.lib, wgpu.ffi, wgpu.ffi.NULL
        self._safe = import_module("wgpu.backends.wgpu_native._api").libf
        self._place = self._ffi.new("uint32_t []", 1)
        self._orders = self._ffi.new("WGPUCommandBuffer []", 1)
        self._submission = self._ffi.new("WGPUSubmissionIndex *")
        self._asked, self._answers = 0, {}  # type: ignore[var-annotated]

        def answered(status: int, _message: Any, number: Any, _nothing: Any) -> None:
            self._answers[int(self._ffi.cast("intptr_t", number))] = status

        kind = "void(WGPUMapAsyncStatus, WGPUStringView, void *, void *)"
        self._answered = self._ffi.callback(kind, answered)

    def encoder(self) -> Any:
        """What orders are written into, until `submit` takes it."""
        return self._plain.wgpuDeviceCreateCommandEncoder(self._device._internal, self._nothing)

    def begin(self, encoder: Any) -> Any:
        """A pass of shaders."""
        return self._plain.wgpuCommandEncoderBeginComputePass(encoder, self._nothing)

    def order(self, begun: Any, pipeline: Any, bound: Any, place: int, groups: Sequence[int]) -> None:
        """One shader of a pass that has begun, its uniform at `place`; what is wrong is raised when it is sent."""
        self._place[0] = place
        self._plain.wgpuComputePassEncoderSetPipeline(begun, pipeline._internal)
        self._plain.wgpuComputePassEncoderSetBindGroup(begun, 0, bound._internal, 1, self._place)
        self._plain.wgpuComputePassEncoderDispatchWorkgroups(begun, *groups, 1)

    def end(self, begun: Any) -> None:
        """Ends a pass."""
        self._plain.wgpuComputePassEncoderEnd(begun)
        self._plain.wgpuComputePassEncoderRelease(begun)

    def clear(self, encoder: Any, buffer: Any) -> None:
        """Sets a buffer to zero, between passes."""
        self._plain.wgpuCommandEncoderClearBuffer(encoder, buffer._internal, 0, self._plain.WGPU_WHOLE_SIZE)

    def copy(self, encoder: Any, source: Any, begins: int, target: Any, at: int, size: int) -> None:
        """Copies bytes of a buffer into another one, between passes."""
        self._plain.wgpuCommandEncoderCopyBufferToBuffer(encoder, source._internal, begins, target._internal, at, size)

    def write(self, buffer: Any, values: NDArray[np.uint8], size: int) -> None:
        """The first `size` bytes of an array into a buffer, before what is submitted next."""
        raw = self._ffi.from_buffer(values)
        self._plain.wgpuQueueWriteBuffer(self._device.queue._internal, buffer._internal, 0, raw, size)

    def submit(self, encoder: Any) -> int:
        """Gives what was written into an encoder to the card; the submission's number."""
        orders = self._safe.wgpuCommandEncoderFinish(encoder, self._nothing)
        self._plain.wgpuCommandEncoderRelease(encoder)
        self._orders[0] = orders
        try:
            return int(self._safe.wgpuQueueSubmitForIndex(self._device.queue._internal, 1, self._orders))
        finally:
            self._plain.wgpuCommandBufferRelease(orders)

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
