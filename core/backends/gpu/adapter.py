"""Which graphics card WebGPU offers here, and a line that says why there is none."""

from __future__ import annotations

import sys
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ...errors import DeviceError

#: WebGPU's native interfaces on each system; OpenGL is left out: its compute shaders are not what others have.
_INTERFACES = {"darwin": ["Metal"], "win32": ["DX12", "Vulkan"]}
#: What a Linux with a graphics card has: the kernel's render nodes, NVIDIA's own, WSL's.
_NODES = ("/dev/dri/renderD*", "/dev/nvidia[0-9]*", "/dev/dxg")


def may_have_card() -> bool:
    """Whether it is worth looking for a card: nothing is loaded, nothing started."""
    if find_spec("wgpu") is None:
        return False
    return sys.platform != "linux" or any(any(Path("/").glob(node[1:])) for node in _NODES)


@cache
def adapters() -> tuple[Any, ...]:
    """WebGPU's adapters, the best first: cards of their own, those in the processor, software.

    Raises:
        DeviceError: wgpu is not installed, or finds none.
    """
    try:
        wgpu, extras = (import_module(name) for name in ("wgpu", "wgpu.backends.wgpu_native.extras"))
    except (ImportError, OSError) as error:
        raise DeviceError(
            f"The gpu back end needs wgpu ({error})", "Run: pip install wgpu; or use --device cpu"
        ) from error
    with suppress(RuntimeError):  # (somebody else in this process may have begun with it)
        extras.set_instance_extras(backends=_INTERFACES.get(sys.platform, ["Vulkan"]))
    order = ("DiscreteGPU", "IntegratedGPU", "Unknown", "CPU")
    found = [a for a in wgpu.gpu.enumerate_adapters_sync() if a.info["adapter_type"] in order]
    if not found:
        raise DeviceError(
            "No graphics card with Vulkan, Metal or DirectX 12 was found",
            "Install your card's driver (on Linux, to try without a card: mesa-vulkan-drivers), or use --device cpu",
        )
    return tuple(sorted(found, key=lambda a: order.index(a.info["adapter_type"])))


def refusals() -> tuple[type[Exception], ...]:
    """What WebGPU raises where a card is lost, out of memory, or does not take an order."""
    return (import_module("wgpu").GPUError, RuntimeError, ValueError, OSError)


def is_software(adapter: Any) -> bool:
    """Whether the adapter is the processor itself (Mesa's llvmpipe, Microsoft's WARP)."""
    return bool(adapter.info["adapter_type"] == "CPU")


def described(adapter: Any) -> str:
    """The adapter in a few words: 'llvmpipe (LLVM 15.0.6, 256 bits), Vulkan, in software'."""
    info = adapter.info
    return f"{info['device']}, {info['backend_type']}" + (", in software" if is_software(adapter) else "")
