"""What a run ran on: versions, processor, memory."""

from __future__ import annotations

import os
import platform
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from .allocator import keep_freed_memory
from .devices import BackendName, choose_device
from .version import VERSION

_LIBRARIES = (
    "torch",
    "numpy",
    "numba",
    "scipy",
    "scikit-image",
    "opencv-python-headless",
    "pycolmap",
    "plyfile",
    "pillow",
    "wgpu",
    "bpy",
)


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def use_machine(count: int | None) -> int:
    """Sets the threads of torch and of the kernels, and keeps what steps free; returns how many threads.

    Call before the first kernel.
    """
    import torch  # heavy: torch

    from .compiled import set_threads  # heavy: numba

    threads = count or cores()
    torch.set_num_threads(threads)
    set_threads(threads)
    keep_freed_memory()
    return threads


def versions() -> dict[str, str]:
    """Version of this program, of Python and of the libraries that are installed."""
    found = {"dgs": VERSION, "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


@dataclass(frozen=True)
class Machine:
    """What a run computes on.

    Attributes:
        threads: of torch and of the kernels; device: the back end's name.
        free: whether a training may go to another device where it is quicker: nobody asked for one by name.
    """

    threads: int
    device: BackendName
    free: bool = False

    @staticmethod
    def ready(threads: int | None, device: BackendName) -> Machine:
        """Sets the threads and finds the device; None: all cores. Call before the first kernel.

        Raises:
            DeviceError: the back end that was asked for is not there.
        """
        return Machine(use_machine(threads), choose_device(device), free=device == "auto")

    @property
    def facts(self) -> dict[str, str | int | float | None]:
        """System, processor, cores, memory."""
        return machine(self.threads, self.device)


def machine(threads: int, device: str) -> dict[str, str | int | float | None]:
    """System, processor, cores, memory."""
    return {
        "system": platform.platform(),
        "processor": _processor(),
        "cores": cores(),
        "threads": threads,
        "device": device,
        "memory_gb": _memory_gb(),
    }


def peak_memory_mb() -> float | None:
    """Most memory that this process held so far, plus the largest of its ended children, in MB.

    An upper bound: the two peaks need not have come together. None where the system does not say.
    """
    try:
        import resource  # late: Windows has none
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return round((own + children) * unit / 1e6, 1)


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass  # not Linux
    return platform.processor() or platform.machine()


def _memory_gb() -> float | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1)
    except (AttributeError, ValueError, OSError):
        return None
