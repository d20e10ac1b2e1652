"""Questions to agents, each answered by as many as are there. Calls that may block on a full connection are made in a
small thread pool; that of a command, for which a client waits, may not: it is given up within a millisecond."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import zenoh

from gateway.fleet.inbox import Payload

_T = TypeVar("_T")
_Answer = tuple[bytes | str, str]  # a payload, or a sentence why there is none; and its key

MAX_REPLIES = 8  # to one question: a robot and, for a moment, the run of its agent before
MAX_STOP_REPLIES = 10_000  # to one question to all robots


class Questions:
    """Made and used in the event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._threads = ThreadPoolExecutor(max_workers=8, thread_name_prefix="link")
        # A stop never waits behind a call that a full connection holds up.
        self._stop_threads = ThreadPoolExecutor(max_workers=16, thread_name_prefix="stop")

    async def in_thread(self, call: Callable[..., _T], *arguments: object) -> _T:
        return await self._loop.run_in_executor(self._threads, call, *arguments)

    def close(self) -> None:
        self._threads.shutdown(wait=False)
        self._stop_threads.shutdown(wait=False)

    async def ask(
        self,
        session: zenoh.Session,
        key: zenoh.KeyExpr | str,
        timeout_s: float,
        limit: int,
        payload: bytes | None,
        judge: Callable[[bytes | str, str], _T | None],
        priority: zenoh.Priority = zenoh.Priority.DATA,
        traceparent: bytes | None = None,
        patient: bool = True,
        sent: Callable[[float], None] = lambda processor_s: None,
    ) -> _T | None:
        """Ask, and return the first answer that ``judge`` makes something of; None when there are no more.

        An answer is a payload, or a sentence why it has none; its key comes with it. Answers have the ``priority``
        of the question. One that is not ``patient`` is not asked over a connection that is full, and goes unanswered.
        ``sent`` is told how much processor time it took to send the question.
        Raises TimeoutError after ``timeout_s``.
        """
        urgent = priority == zenoh.Priority.REAL_TIME
        answers: asyncio.Queue[_Answer | None] = asyncio.Queue(1 + (MAX_STOP_REPLIES if urgent else MAX_REPLIES))

        def put(answer: _Answer | None) -> None:
            if answer is None and answers.full():
                answers.get_nowait()
            if not answers.full():  # what comes beyond is nobody's honest answer
                answers.put_nowait(answer)

        def hand_over(answer: _Answer | None) -> None:
            with contextlib.suppress(RuntimeError):  # the loop was closed while the question was under way
                self._loop.call_soon_threadsafe(put, answer)

        def get() -> float:
            begin_s = time.thread_time()
            handler: Any = zenoh.handlers.Callback(
                lambda reply: hand_over(_answer(reply, limit, str(key))), drop=lambda: hand_over(None), indirect=False
            )
            session.get(
                key,
                handler,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,  # two runs of an agent answer under one key
                timeout=timeout_s,
                payload=payload,
                attachment=traceparent,
                express=True,
                priority=priority,
                congestion_control=zenoh.CongestionControl.BLOCK if patient else zenoh.CongestionControl.DROP,
            )
            return time.thread_time() - begin_s

        async with asyncio.timeout(timeout_s):
            if patient:
                sent(await self._loop.run_in_executor(self._stop_threads if urgent else self._threads, get))
            else:
                sent(get())
            while (answer := await answers.get()) is not None:
                judged = judge(*answer)
                if judged is not None:
                    return judged
        return None


def bounded(payload: zenoh.ZBytes, limit: int) -> Payload:
    """The payload, or its length when that is above the limit: such a payload is never copied."""
    size = len(payload)
    return payload.to_bytes() if size <= limit else size


def _answer(reply: zenoh.Reply, limit: int, asked: str) -> _Answer:
    if reply.ok is None:
        return "the agent answered with an error", asked
    payload = bounded(reply.ok.payload, limit)
    said = payload if isinstance(payload, bytes) else f"the answer has {payload} bytes; {limit} are the most"
    return said, str(reply.ok.key_expr)
