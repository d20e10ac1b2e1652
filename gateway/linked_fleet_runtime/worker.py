"""Child processes for untrusted input and long computations."""

import asyncio
import os
import sys
from asyncio.subprocess import Process
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, ClassVar

# Other environment variables are withheld from worker processes.
_INHERITED = ("PATH", "PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "VIRTUAL_ENV")


_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""For numpy: threads of one computation wait for each other while other processes use the processors."""


class Worker:
    """A process ``python -m module`` with a reduced environment and no terminal.

    Its user starts it when it is first needed, bounds the time of an answer, and ends a process that gave none. After
    ``idle_s`` seconds outside of ``in_use`` it ends: ``on_idle`` is awaited, which calls ``end`` before its first
    await, so that no use can begin in between.
    """

    IDLE_S: ClassVar[float] = 300.0
    """Seconds without use after which a process ends. Each takes more memory than the gateway, or nearly as much."""

    def __init__(
        self,
        module: str,
        environment: Mapping[str, str] | None = None,
        *,
        idle_s: float = IDLE_S,
        on_idle: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        self._module, self._environment = module, dict(environment or {})
        self._idle_s, self._on_idle = idle_s, on_idle or self.end
        self._process: Process | None = None
        self._ended = False
        self._uses = 0
        self._timer: asyncio.TimerHandle | None = None
        self._ending: asyncio.Task[None] | None = None

    @property
    def running(self) -> bool:
        return self._process is not None and not self._ended and self._process.returncode is None

    @property
    def process(self) -> Process:
        """The present process, or the last one."""
        assert self._process is not None
        return self._process

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Keep the process from ending while the context is entered; contexts may overlap."""
        self._uses += 1
        self._cancel_timer()
        try:
            yield
        finally:
            self._uses -= 1
            if not self._uses:
                self._timer = asyncio.get_running_loop().call_later(self._idle_s, self._become_idle)

    async def start(self, *arguments: str, **pipes: Any) -> Process:
        """Start a process, ending the previous one; ``pipes`` as for ``create_subprocess_exec``."""
        await self.end()
        environment = {name: os.environ[name] for name in _INHERITED if name in os.environ}
        # A session of its own, so that Ctrl-C goes to the gateway only; the process ends when its pipe closes.
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", self._module, *arguments,
            env=environment | _ONE_THREAD | self._environment, start_new_session=True, **pipes,
        )  # fmt: skip
        self._ended = False
        return self._process

    async def end(self) -> None:
        """Kill the process, if it runs, and wait for its end, also if another call has killed it."""
        self._cancel_timer()
        self._ended = True
        if self._process is not None and self._process.returncode is None:
            with suppress(ProcessLookupError):
                self._process.kill()
            await self._process.wait()

    def _become_idle(self) -> None:
        self._ending = asyncio.create_task(self._end_idle(), name=f"end idle {self._module}")

    async def _end_idle(self) -> None:
        if not self._uses:
            await self._on_idle()

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
