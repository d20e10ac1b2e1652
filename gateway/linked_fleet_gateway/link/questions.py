"""Questions to agents, each answered by as many as are there."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from linked_fleet_gateway.link.transport import Answer, Question, Session

_T = TypeVar("_T")

MAX_REPLIES = 8  # to one question: a robot and, for a moment, the run of its agent before
MAX_STOP_REPLIES = 10_000  # to one question to all robots


async def ask(
    session: Session,
    question: Question,
    judge: Callable[[bytes | str, str], _T | None],
    sent: Callable[[float], None] = lambda processor_s: None,
) -> _T | None:
    """Ask, and return the first answer that ``judge`` makes something of; None when there are no more.

    ``judge`` gets a payload, or a sentence why there is none, and the key of the answer. ``sent`` is told how much
    processor time it took to send the question. Raises TimeoutError after the ``timeout_s`` of the question.
    """
    most = MAX_STOP_REPLIES if question.priority == "real time" else MAX_REPLIES
    answers: asyncio.Queue[Answer | None] = asyncio.Queue(1 + most)

    def put(answer: Answer | None) -> None:
        if answer is None and answers.full():
            answers.get_nowait()
        if not answers.full():  # what comes beyond is nobody's honest answer
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
