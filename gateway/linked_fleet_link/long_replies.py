"""Descriptions, meshes and pictures, asked for in parts (PROTOCOL.md, "Parts of a reply").

Each part is asked for when the one before has arrived, and is as long as the link carries in about a tenth of a second.
So commands, stops and frames wait for one part at most, also on a link that needs a minute for the whole. Congestion
drops a part, which is asked for again; only the first, of 64 KiB, may wait for a connection, because an agent of an
earlier release answers it with the whole reply.
"""

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from linked_fleet_agent.wire.parts import PART_BYTES, PartRequest
from linked_fleet_link.transport import Answer, Question, Session, ask_for_answer, payload_or_reason

_T = TypeVar("_T")
Judge = Callable[[bytes | str, str], _T | None]

MAX_TRANSFER_S = 120.0
"""Time for all parts of a reply."""
PART_TIMEOUT_S = 5.0
MAX_INTERRUPTED_BYTES = 64 * 2**20
"""Bytes of interrupted replies that are kept, so that the next question resumes them."""
_TRIES = 4  # of one part
_PAUSE_S = 0.05
SHORTEST_BYTES, LONGEST_BYTES = 8_192, 131_072
_QUICK_S, _SLOW_S = 0.1, 0.3


@dataclass
class _Transfer:
    """One content under way from the senders on ``key``; ``length`` is that of the next part."""

    key: str
    tag: str
    total: int
    content: bytearray = field(default_factory=bytearray)
    length: int = PART_BYTES

    @property
    def is_complete(self) -> bool:
        return len(self.content) >= self.total

    def take(self, part: bytes, took_s: float) -> None:
        self.content += part
        # After a loss a part grows again, also on a link whose round trip alone takes long.
        if took_s < (_SLOW_S if self.length < PART_BYTES else _QUICK_S):
            self.length = min(2 * self.length, LONGEST_BYTES)
        elif took_s > _SLOW_S:
            self.shorten()

    def shorten(self) -> None:
        self.length = max(self.length // 2, SHORTEST_BYTES)


class LongReplies:
    """Replies in parts through one session."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._loop = asyncio.get_running_loop()
        self._interrupted: OrderedDict[tuple[str, bytes | None], _Transfer] = OrderedDict()

    async def ask(
        self,
        question: Question,
        judge: Judge[_T],
        sent: Callable[[float], None] = lambda processor_s: None,
        resume: bool = True,
    ) -> _T | None:
        """Return the first result of ``judge`` that is not None, as ``transport.ask`` does.

        ``timeout_s`` of the question is for its first part. Raises TimeoutError after it, or with a sentence if a later
        part is missing. With ``resume``, what has arrived is kept then, and the next such question goes on from there.
        """
        resumed = self._interrupted.pop((question.key, question.payload), None) if resume else None
        if resumed is not None:
            resumed.length = PART_BYTES
            judged = await self._complete(question, resumed, judge)
            if judged is not None:
                return judged
        begun = list[_Transfer]()
        judged = await self._begin(question, begun, judge, sent)
        for transfer in [] if judged is not None else begun:
            judged = await self._complete(question, transfer, judge)
            if judged is not None:
                break
        return judged

    async def _begin(
        self, question: Question, begun: list[_Transfer], judge: Judge[_T], sent: Callable[[float], None]
    ) -> _T | None:
        """Ask for the first part; ``begun`` gets the replies that have more. Raises TimeoutError if there are none."""
        begin_s = self._loop.time()

        def first(answer: Answer) -> _T | None:
            said, head = payload_or_reason(answer, question.limit), answer.head
            if head is None or isinstance(said, str) or len(said) >= head.total:
                return judge(said, answer.key)
            if head.total > question.limit:
                return judge(f"the answer has {head.total} bytes; {question.limit} are the most", answer.key)
            begun.append(_Transfer(answer.key, head.tag, head.total))
            begun[-1].take(said, self._loop.time() - begin_s)
            return None

        asked = question._replace(part=PartRequest("", 0, PART_BYTES))
        try:
            return await ask_for_answer(self._session, asked, first, sent)
        except TimeoutError:
            if not begun:
                raise
            return None

    async def _complete(self, question: Question, transfer: _Transfer, judge: Judge[_T]) -> _T | None:
        end_s = self._loop.time() + MAX_TRANSFER_S
        tries = 0
        try:
            while not transfer.is_complete:
                if self._loop.time() >= end_s:
                    raise TimeoutError(_too_slow(transfer, f"the most is {MAX_TRANSFER_S:.0f} s"))
                begin_s = self._loop.time()
                part = await self._part(question, transfer)
                if isinstance(part, str):
                    return judge(part, transfer.key)
                if part is not None:
                    tries = 0
                    transfer.take(part, self._loop.time() - begin_s)
                    continue
                tries += 1
                if tries == _TRIES:
                    raise TimeoutError(_too_slow(transfer, "the next part did not arrive"))
                transfer.shorten()
                await asyncio.sleep(_PAUSE_S)
        except (TimeoutError, asyncio.CancelledError):
            self._keep(question, transfer)
            raise
        return judge(bytes(transfer.content), transfer.key)

    async def _part(self, question: Question, transfer: _Transfer) -> bytes | str | None:
        """Return the next part, a sentence if the content is not available any more, or None if nothing arrived."""
        reasons = list[str]()

        def next_part(answer: Answer) -> bytes | None:
            said, head = payload_or_reason(answer, question.limit), answer.head
            if isinstance(said, str):
                reasons.append(said)
                return None
            fits = head is not None and head.tag == transfer.tag and 0 < len(said) <= transfer.length
            return said if fits and len(transfer.content) + len(said) <= transfer.total else None

        asked = PartRequest(transfer.tag, len(transfer.content), transfer.length)
        begin_s = self._loop.time()
        asking = question._replace(part=asked, timeout_s=PART_TIMEOUT_S, blocking=False)
        try:
            part = await ask_for_answer(self._session, asking, next_part)
        except TimeoutError:
            return None
        # Zenoh also ends a query that nobody has answered in time with an error.
        late = self._loop.time() - begin_s >= PART_TIMEOUT_S / 2
        return part if part is not None or late or not reasons else reasons[-1]

    def _keep(self, question: Question, transfer: _Transfer) -> None:
        self._interrupted[question.key, question.payload] = transfer
        while sum(len(each.content) for each in self._interrupted.values()) > MAX_INTERRUPTED_BYTES:
            self._interrupted.popitem(last=False)


def _too_slow(transfer: _Transfer, reason: str) -> str:
    return (
        f"{len(transfer.content)} of {transfer.total} bytes arrived, and {reason}; the next request goes on from there"
    )
