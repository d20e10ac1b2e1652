"""Zenoh queries to agents, each answered by all matching queryables."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from linked_fleet_gateway.link.transport import Answer, Question, Session

_T = TypeVar("_T")

MAX_REPLIES = 8  # to one query: a robot and, briefly, the previous run of its agent
MAX_STOP_REPLIES = 10_000  # to one query to all robots


async def ask(
    session: Session,
    question: Question,
    judge: Callable[[bytes | str, str], _T | None],
    sent: Callable[[float], None] = lambda processor_s: None,
) -> _T | None:
    """Send a query and return the first result of ``judge`` that is not None; None if there are no more replies.

    ``judge`` gets a payload, or a sentence why there is none, and the key of the reply. ``sent`` gets the processor
    time in seconds for sending. Raises TimeoutError after the query's ``timeout_s``.
    """
    most = MAX_STOP_REPLIES if question.priority == "real time" else MAX_REPLIES
    answers: asyncio.Queue[Answer | None] = asyncio.Queue(1 + most)

    def put(answer: Answer | None) -> None:
        if answer is None and answers.full():
            answers.get_nowait()
        if not answers.full():  # further replies cannot be genuine
            answers.put_nowait(answer)

    async with asyncio.timeout(question.timeout_s):
        sent(await session.ask(question, put))
        while (answer := await answers.get()) is not None:
            judged = judge(_said(answer, question.limit), answer.key)
            if judged is not None:
                return judged
    return None


def _said(answer: Answer, limit: int) -> bytes | str:
    if answer.payload is None:
        return "the agent answered with an error"
    if isinstance(answer.payload, int):
        return f"the answer has {answer.payload} bytes; {limit} are the most"
    return answer.payload
