"""The gateway's side of the check process: started with the first question, restarted after it has ended."""

import asyncio
import logging
from asyncio.subprocess import PIPE
from pathlib import Path

import msgspec

from linked_fleet_gateway.extensions.world.messages import Answer, CheckFailed, Prepare, PrepareObject, Question, Ready
from linked_fleet_gateway.runtime.worker import Worker

_log = logging.getLogger(__name__)

_HEAD_BYTES = 4
_MAX_ANSWER_BYTES = 128 * 1024  # digests of all the meshes of a robot
_ANSWERS = msgspec.msgpack.Decoder(Answer)
NO_ANSWER = CheckFailed("the process that checks motions gave no answer")


class Checker:
    """Sends one question at a time. Meshes are cached in ``folder``."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: set[str] = set()
        self._worker = Worker("linked_fleet_gateway.extensions.world.worker")
        self._turn = asyncio.Lock()

    def knows(self, key: str) -> bool:
        """Return True if the present process has prepared it."""
        return key in self._known and self._worker.running

    async def ask(self, question: Question, timeout_s: float) -> Answer:
        """Return the answer, or ``NO_ANSWER`` after ``timeout_s``, when the process is killed.

        Not affected by cancellation.
        """
        return await asyncio.shield(asyncio.create_task(self._in_turn(question, timeout_s)))

    async def _in_turn(self, question: Question, timeout_s: float) -> Answer:
        async with self._turn:
            try:
                async with asyncio.timeout(timeout_s):
                    return await self._exchange(question)
            except (TimeoutError, OSError, EOFError, msgspec.ValidationError) as error:
                _log.warning("the process that checks motions gave no answer and is started anew: %r", error)
                await self.close()
                return NO_ANSWER
            except asyncio.CancelledError:
                await self.close()
                raise

    async def _exchange(self, question: Question) -> Answer:
        if not self._worker.running:
            self._known.clear()
            await self._worker.start(str(self._folder), stdin=PIPE, stdout=PIPE)
        stdin, stdout = self._worker.process.stdin, self._worker.process.stdout
        assert stdin is not None and stdout is not None
        body = msgspec.msgpack.encode(question)
        stdin.write(len(body).to_bytes(_HEAD_BYTES, "little") + body)
        await stdin.drain()
        size = int.from_bytes(await stdout.readexactly(_HEAD_BYTES), "little")
        if size > _MAX_ANSWER_BYTES:
            raise EOFError("its answer is none")
        answer: Answer = _ANSWERS.decode(await stdout.readexactly(size))
        if isinstance(question, Prepare | PrepareObject) and isinstance(answer, Ready):
            self._known.add(question.key)
        return answer

    async def close(self) -> None:
        self._known.clear()
        await self._worker.end()
