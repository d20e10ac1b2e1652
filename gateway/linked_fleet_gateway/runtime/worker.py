"""Child processes for untrusted input and long computations."""

import asyncio
import os
import sys
from asyncio.subprocess import Process
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

# Other environment variables are withheld from worker processes.
_INHERITED = ("PATH", "PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "VIRTUAL_ENV")


class Worker:
    """A process ``python -m module`` with a reduced environment and no terminal.

    Its user bounds the time of an answer, and ends a process that gave none.
    """

    def __init__(self, module: str, environment: Mapping[str, str] | None = None) -> None:
        self._module, self._environment = module, dict(environment or {})
        self._process: Process | None = None

    @property
    def running(self) -> bool:
        return self._process is not None and self._process.returncode is None

    @property
    def process(self) -> Process:
        """The present process, or the last one."""
        assert self._process is not None
        return self._process

    async def start(self, *arguments: str, **pipes: Any) -> Process:
        """Start a process, ending the previous one; ``pipes`` as for ``create_subprocess_exec``."""
        await self.end()
        environment = {name: os.environ[name] for name in _INHERITED if name in os.environ}
        # A session of its own, so that Ctrl-C goes to the gateway only; the process ends when its pipe closes.
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", self._module, *arguments,
            env=environment | self._environment, start_new_session=True, **pipes,
        )  # fmt: skip
        return self._process

    async def end(self) -> None:
        """Kill the process, if it runs, and wait for its end."""
        process, self._process = self._process, None
        if process is not None and process.returncode is None:
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()
