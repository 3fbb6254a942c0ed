"""Prints the Debian packages whose libraries bpy and pycolmap miss on this machine, if any."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
from pathlib import Path

#: Debian's and Ubuntu's names for what the wheels link to and do not bring along.
PACKAGES = {
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1",
    "libXxf86vm.so.1": "libxxf86vm1",
    "libxcb.so.1": "libxcb1",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libOpenGL.so.0": "libopengl0",
    "libuuid.so.1": "libuuid1",
    "libgomp.so.1": "libgomp1",
    "libstdc++.so.6": "libstdc++6",
}


def missing_libraries(files: list[Path]) -> set[str]:
    """Names of shared libraries that the loader cannot find for any of `files`."""
    missing: set[str] = set()
    for file in files:
        listing = subprocess.run(["ldd", str(file)], capture_output=True, text=True, check=False).stdout
        missing |= {line.split()[0] for line in listing.splitlines() if line.rstrip().endswith("not found")}
    return missing


def main() -> int:
    """Prints package names, space-separated; libraries of unknown origin are named on stderr."""
    site = Path(sysconfig.get_paths()["purelib"])
    modules = [*site.glob("bpy/__init__*.so"), *site.glob("pycolmap/_core*.so")]
    missing = missing_libraries(modules)
    unknown = sorted(missing - PACKAGES.keys())
    if unknown:
        print(f"Install the packages that bring {', '.join(unknown)}.", file=sys.stderr)
    print(" ".join(sorted(PACKAGES[name] for name in missing & PACKAGES.keys())))
    return 0


if __name__ == "__main__":
    sys.exit(main())
