"""The process that checks motions, from outside: started at the first question, and anew when it has ended."""

import asyncio
import contextlib
import logging
import os
import sys
from asyncio.subprocess import PIPE, Process
from pathlib import Path

import msgspec

from gateway.extensions.world.messages import Answer, Prepare, PrepareObject, Question, Ready, Unable

_log = logging.getLogger(__name__)

_HEAD_BYTES = 4
_MAX_ANSWER_BYTES = 128 * 1024  # digests of all the meshes of a robot
# Nothing else of the environment: what is in there is none of its business.
_INHERITED = ("PATH", "PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH", "LANG", "TMPDIR")
_MODULE = "gateway.extensions.world.worker"
_ANSWERS = msgspec.msgpack.Decoder(Answer)
NO_ANSWER = Unable("the process that checks motions gave no answer")


class Checker:
    """One question after another. Meshes are kept in ``folder``."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: set[str] = set()
        self._process: Process | None = None
        self._turn = asyncio.Lock()

    def knows(self, key: str) -> bool:
        """Return True if the present process has prepared it."""
        return key in self._known and self._process is not None and self._process.returncode is None

    async def ask(self, question: Question, timeout_s: float) -> Answer:
        """``NO_ANSWER``, and the process is ended, when none comes in time. Who goes away does not disturb it."""
        return await asyncio.shield(asyncio.create_task(self._in_turn(question, timeout_s)))

    async def _in_turn(self, question: Question, timeout_s: float) -> Answer:
        async with self._turn:
            try:
                async with asyncio.timeout(timeout_s):
                    return await self._exchange(question)
            except (TimeoutError, OSError, EOFError, msgspec.ValidationError) as error:
                _log.warning("the process that checks motions gave no answer and is started anew: %r", error)
                await self._end()
                return NO_ANSWER
            except asyncio.CancelledError:
                await self._end()
                raise

    async def _exchange(self, question: Question) -> Answer:
        if self._process is None or self._process.returncode is not None:
            await self._start()
        assert self._process is not None and self._process.stdin is not None and self._process.stdout is not None
        body = msgspec.msgpack.encode(question)
        self._process.stdin.write(len(body).to_bytes(_HEAD_BYTES, "little") + body)
        await self._process.stdin.drain()
        size = int.from_bytes(await self._process.stdout.readexactly(_HEAD_BYTES), "little")
        if size > _MAX_ANSWER_BYTES:
            raise EOFError("its answer is none")
        answer: Answer = _ANSWERS.decode(await self._process.stdout.readexactly(size))
        if isinstance(question, Prepare | PrepareObject) and isinstance(answer, Ready):
            self._known.add(question.key)
        return answer

    async def _start(self) -> None:
        self._known.clear()
        environment = {name: os.environ[name] for name in _INHERITED if name in os.environ}
        # A session of its own: Ctrl-C is for the gateway, with whose end of the pipe this process ends.
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            _MODULE,
            str(self._folder),
            stdin=PIPE,
            stdout=PIPE,
            env=environment,
            start_new_session=True,
        )

    async def _end(self) -> None:
        process, self._process = self._process, None
        self._known.clear()
        if process is not None and process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()

    async def close(self) -> None:
        await self._end()
