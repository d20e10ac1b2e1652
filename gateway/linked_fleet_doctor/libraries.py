"""Check that the libraries in machine code can be loaded with those of the system."""

import asyncio
import re
import sys
from asyncio.subprocess import DEVNULL, PIPE
from collections.abc import Sequence

from linked_fleet_doctor.finding import Finding

LIBRARIES = {
    "pinocchio": "reach and lf:canReach fail, and motions of placed robots are refused",
    "coal": "motions of placed robots are refused",
    "mujoco": "robots cannot be simulated",
}
"""Modules in machine code, and the consequence of each that cannot be loaded."""
_LOAD_S = 60.0
_PACKAGES = {
    "libgomp.so.1": "libgomp1",
    "libstdc++.so.6": "libstdc++6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
}
"""Debian and Ubuntu packages of system libraries."""
_SYSTEM_LIBRARY = re.compile(r"[\w+.-]+\.so(?:\.\d+)*(?=:)")


async def check_libraries(modules: Sequence[str] = tuple(LIBRARIES)) -> list[Finding]:
    """Load each module in a process of its own, since a library that does not fit may end its process."""
    return list(await asyncio.gather(*map(_library, modules)))


async def _library(module: str) -> Finding:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-P", "-c", f"import {module}", stdin=DEVNULL, stdout=DEVNULL, stderr=PIPE
    )
    try:
        async with asyncio.timeout(_LOAD_S):
            _, said = await process.communicate()
    except TimeoutError:
        process.kill()
        await process.wait()
        return _unusable(module, f"is not loaded after {_LOAD_S:.0f} s", "run doctor again when the machine is idle")
    if process.returncode == 0:
        return Finding("libraries", f"{module} can be loaded")
    if process.returncode is not None and process.returncode < 0:
        reason = f"ends its process by signal {-process.returncode}"
        return _unusable(module, reason, "install a version that fits this processor and system")
    lines = said.decode(errors="replace").strip().splitlines()
    kind, _, message = (lines[-1] if lines else "Error").partition(": ")
    if kind == "ModuleNotFoundError":
        return _unusable(module, f"is not installed: {message}", "pip install linked-fleet")
    return _unusable(module, f"cannot be loaded: {message or kind}", _advice(message))


def _advice(message: str) -> str:
    """Return how to install the library that the message of the loader names."""
    found = _SYSTEM_LIBRARY.search(message)
    if found is None:
        return "reinstall it: pip install --force-reinstall linked-fleet"
    if found[0] in _PACKAGES:
        return f"apt install {_PACKAGES[found[0]]}, or the package with {found[0]} of another system"
    return f"install the package of this system that has {found[0]}"


def _unusable(module: str, reason: str, advice: str) -> Finding:
    consequence = LIBRARIES.get(module)
    return Finding("libraries", f"{module} {reason}" + (f", so {consequence}" if consequence else ""), advice)
