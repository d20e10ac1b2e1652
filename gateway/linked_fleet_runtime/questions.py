"""Questions to a child process, one at a time: MessagePack with its length before it, on standard input and output.

``linked_fleet_base.answering`` is the other side.
"""

import asyncio
import logging
from asyncio.subprocess import PIPE
from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager
from typing import Generic, TypeVar

import msgspec

from linked_fleet_base.answering import LENGTH
from linked_fleet_runtime.worker import Worker

log = logging.getLogger(__name__)

_MAX_ANSWER_BYTES = 2 * 2**20
Question = TypeVar("Question")
Answer = TypeVar("Answer")


class NoReply(Exception):  # noqa: N818
    """The process has given no answer, and was killed."""


class QuestionProcess(Generic[Question, Answer]):
    """A process ``python -m module`` that answers questions, started for the first one and ended when idle.

    ``answers`` decodes its answers. ``on_idle`` is called before an idle process ends.
    """

    def __init__(
        self,
        module: str,
        answers: "msgspec.msgpack.Decoder[Answer]",
        *arguments: str,
        idle_s: float = Worker.IDLE_S,
        on_idle: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        self._module, self._answers, self._arguments = module, answers, arguments
        self._worker = Worker(module, idle_s=idle_s, on_idle=on_idle)
        self._turn = asyncio.Lock()

    @property
    def running(self) -> bool:
        return self._worker.running

    def in_use(self) -> AbstractContextManager[None]:
        """Keep the process, if it runs, from ending because it is idle."""
        return self._worker.in_use()

    async def ask(self, question: Question, timeout_s: float) -> Answer:
        """Return the answer. Raises NoReply after ``timeout_s``, when the process is killed.

        Cancelling it neither kills the process nor disturbs its next question.
        """
        return await asyncio.shield(asyncio.create_task(self._in_turn(question, timeout_s)))

    async def end(self) -> None:
        await self._worker.end()

    async def _in_turn(self, question: Question, timeout_s: float) -> Answer:
        async with self._turn:
            with self.in_use():
                return await self._answer(question, timeout_s)

    async def _answer(self, question: Question, timeout_s: float) -> Answer:
        try:
            async with asyncio.timeout(timeout_s):
                return await self._exchange(question)
        except (TimeoutError, OSError, EOFError, msgspec.ValidationError) as error:
            log.warning("the process %s gave no answer and is restarted: %r", self._module, error)
            await self.end()
            raise NoReply from error
        except asyncio.CancelledError:
            await self.end()
            raise

    async def _exchange(self, question: Question) -> Answer:
        if not self._worker.running:
            await self._worker.start(*self._arguments, stdin=PIPE, stdout=PIPE)
        stdin, stdout = self._worker.process.stdin, self._worker.process.stdout
        assert stdin is not None and stdout is not None
        body = msgspec.msgpack.encode(question)
        stdin.write(LENGTH.pack(len(body)) + body)
        await stdin.drain()
        (size,) = LENGTH.unpack(await stdout.readexactly(LENGTH.size))
        if size > _MAX_ANSWER_BYTES:
            raise EOFError("its answer is none")
        return self._answers.decode(await stdout.readexactly(size))
