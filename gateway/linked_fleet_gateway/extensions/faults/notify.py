"""Messages about faults by mail, chat and all else that the package apprise reaches.

The addresses are those of the operator, from a file, because they contain passwords. Sending blocks, so that it is done
in a thread, one message at a time.
"""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path

from msgspec.structs import replace

from linked_fleet_gateway.api import NotFound
from linked_fleet_gateway.extensions.faults.fault import Fault
from linked_fleet_gateway.extensions.faults.ledger import Change
from linked_fleet_gateway.extensions.faults.messages import Message, Telling

log = logging.getLogger(__name__)

SEND_S = 30.0
"""The longest that a message may take."""
LOOK_S = 1.0
MOST_ADDRESSES = 20
Send = Callable[[str, str], Awaitable[bool]]
"""Sends a message with this title and text. Returns False if it could not be sent to all addresses."""


class Notifier:
    """Sends messages while this gateway ``leads``. One that could not be sent is sent again a minute later."""

    def __init__(
        self,
        telling: Telling,
        send: Send,
        leads: Callable[[], bool],
        known: Mapping[str, Fault],
        change: Callable[[str, Change], Awaitable[Fault]],
    ) -> None:
        self._telling, self._send, self._leads, self._known, self._change = telling, send, leads, known, change
        self._last_ns = 0
        self.sent = 0
        self.failed = 0

    async def look(self) -> None:
        """Send the message that is due, if any. Raises RedisUnavailable."""
        now_ns = time.time_ns()
        message = self._telling.message(self._known, self._last_ns, now_ns) if self._leads() else None
        if message is None:
            return
        self._last_ns = now_ns
        if not await self._has_sent(message):
            self.failed += 1
            log.warning("a message about %d faults could not be sent to all addresses", len(message.faults))
            return
        self.sent += 1
        for id in message.faults:
            await self._note(id, now_ns)

    async def _has_sent(self, message: Message) -> bool:
        try:
            async with asyncio.timeout(SEND_S):
                return await self._send(message.title, message.text)
        except TimeoutError:
            return False

    async def _note(self, id: str, now_ns: int) -> None:
        try:
            await self._change(id, lambda fault: replace(fault, told_ns=now_ns))
        except NotFound:
            return  # it has been deleted meanwhile


def by_apprise(file: Path) -> Send:
    """Return what sends to the addresses in a file, one a line. Raises OSError, ValueError, ImportError."""
    import apprise

    addresses = [each.strip() for each in file.read_text().splitlines() if each.strip() and not each.startswith("#")]
    if not 1 <= len(addresses) <= MOST_ADDRESSES:
        raise ValueError(f"{file.name} has {len(addresses)} addresses; it has 1 to {MOST_ADDRESSES}, one a line")
    people = apprise.Apprise()
    for number, each in enumerate(addresses, 1):
        if not people.add(each):
            raise ValueError(f"address {number} of {file.name} is none that apprise understands")

    async def send(title: str, text: str) -> bool:
        return bool(await asyncio.to_thread(people.notify, body=text, title=title))

    return send
