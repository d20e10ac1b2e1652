"""Clients that create callbacks over HTTP, the receiver of all of them, and the observed robot."""

import asyncio
import contextlib
import random
import re
from collections.abc import Sequence
from hashlib import blake2b

from gateway_group import STEPS, Hub
from histories.history import History
from histories.web import HttpGateway, last_segment

_MOST = 10  # at once
_STEP_S = 0.3
_PATIENCE_S, _LOOK_S = 40.0, 0.05
_SHOWN = 100  # lines of a log
_REFUSED, _ANSWER_LOST = 0.05, 0.05
_PREFIXES = "@prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> .\n"
_MEMBER = re.compile(r"ldp#contains> <([^>]+)>")
_VALUE = re.compile(r'vom:numericalValue (?:"([^"]+)"|lf:unknown)')


class HttpReceiver:
    """Records each complete message, even if its response is lost."""

    def __init__(self, history: History, draws: random.Random) -> None:
        self._history, self._draws = history, draws
        self._numbers: dict[str, int] = {}
        self.last: dict[str, int] = {}
        """Step of the last new message, by subscription."""
        self.port = 0

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        broken = contextlib.suppress(OSError, asyncio.IncompleteReadError, asyncio.CancelledError)
        with broken, contextlib.closing(writer):
            while self._answer(await self._read(reader), writer):
                await writer.drain()

    async def _read(self, reader: asyncio.StreamReader) -> tuple[dict[str, str], bytes]:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().splitlines()[1:-1]
        headers = {name.lower(): value for name, _, value in (line.partition(": ") for line in head)}
        return headers, await reader.readexactly(int(headers["content-length"]))

    def _answer(self, message: tuple[dict[str, str], bytes], writer: asyncio.StreamWriter) -> bool:
        draw = self._draws.random()
        if draw < _REFUSED:
            writer.write(b"HTTP/1.1 503 Busy\r\ncontent-length: 0\r\n\r\n")
            return True
        self._note(*message)
        if draw < _REFUSED + _ANSWER_LOST:
            return False
        writer.write(b"HTTP/1.1 204 Taken\r\n\r\n")
        return True

    def _note(self, headers: dict[str, str], body: bytes) -> None:
        subscription, number = headers["webhook-id"].rpartition(".")[0], int(headers["linked-fleet-delivery"])
        found = _VALUE.search(body.decode())
        assert found, body
        # A gateway that has just taken a callback over may not have seen a frame yet: the value is unknown then.
        rank = self.last.get(subscription, 0) if found[1] is None else round(float(found[1]) * STEPS)
        content = blake2b(body, digest_size=6).hexdigest()
        now_ns = self._history.now_ns()
        self._history.happened("callback", subscription, "deliver", now_ns, number=number, rank=rank, content=content)
        if number > self._numbers.get(subscription, 0):
            self._numbers[subscription], self.last[subscription] = number, rank


class Subscribers:
    """Create, list and delete callbacks on the joint of the hub's robot."""

    def __init__(
        self,
        history: History,
        hub: Hub,
        container: str,
        resource: str,
        receiver: HttpReceiver,
        gateways: Sequence[HttpGateway],
    ) -> None:
        self._history, self._hub, self._container, self._resource = history, hub, container, resource
        self._receiver, self._moving = receiver, True
        self._gateways = gateways
        self._ids: list[str] = []
        self._deleted: set[str] = set()
        self._accepted: set[str] = set()

    async def move(self) -> None:
        while self._moving:
            self._hub.step()
            await asyncio.sleep(_STEP_S)

    async def act(self, client: int, gateway: HttpGateway, draws: random.Random) -> None:
        draw = draws.random()
        if draw < 0.2:
            await self._list(client, gateway)
        elif len(self._ids) < _MOST:
            await self._create(client, gateway)
        elif draw < 0.3:
            await self._delete(client, gateway, draws.choice(self._ids))

    async def _create(self, client: int, gateway: HttpGateway) -> None:
        body = (
            f"{_PREFIXES}[] a hybrit:Subscription, hybrit:WebCallback ; hybrit:onResource <{self._resource}> ; "
            f'hybrit:callbackURL "http://127.0.0.1:{self._receiver.port}/" .'
        )
        since_ns = self._history.now_ns()
        answer = await gateway.ask("POST", self._container, body)
        assert answer.status == 201, answer.text
        id = last_segment(answer.headers["location"])
        self._history.happened("subscription", id, "create", since_ns, is_="there")
        self._ids.append(id)
        self._accepted.add(id)

    async def _list(self, client: int, gateway: HttpGateway) -> None:
        asked = {id: self._history.asks(client, "subscription", id, "list") for id in self._ids}
        answer = await gateway.ask("GET", self._container, accept="application/n-triples")
        listed = {last_segment(iri) for iri in _MEMBER.findall(answer.text)}
        for id, each in asked.items():
            each.answered(is_="there" if id in listed else "none")

    async def _delete(self, client: int, gateway: HttpGateway, id: str) -> None:
        self._deleted.add(id)
        called = self._history.calls(client, "subscription", id, "delete")
        if id in self._ids:
            self._ids.remove(id)
        answer = await gateway.ask("DELETE", f"{self._container}/{id}")
        called.answered(is_={204: "there", 404: "none"}[answer.status])

    async def settle(self, gateway: HttpGateway) -> None:
        """Wait until each accepted, undeleted callback has been sent the joint's final position."""
        self._moving = False
        lasting = sorted(self._accepted - self._deleted)
        with contextlib.suppress(TimeoutError):  # the history then shows what is missing
            async with asyncio.timeout(_PATIENCE_S):
                while not all(self._receiver.last.get(id) == self._hub.steps for id in lasting):
                    self._hub.repeat()
                    await asyncio.sleep(_LOOK_S)
        await self._list(0, gateway)
        await self._show([id for id in lasting if self._receiver.last.get(id) != self._hub.steps], gateway)
        for id in lasting:
            self._history.happened("callback", id, "settled", self._history.now_ns(), rank=self._hub.steps)

    async def _show(self, missing: Sequence[str], gateway: HttpGateway) -> None:
        """Print the callbacks that have not been sent the final position, and what the gateways logged of late."""
        for id in missing:
            answer = await gateway.ask("GET", f"{self._container}/{id}", accept="text/turtle")
            print(f"callback {id}: {answer.status}\n{answer.text}")
        for each in self._gateways if missing else ():
            lines = [line for line in each.log.splitlines() if "gateway.audit" not in line]
            print(f"gateway at port {each.port}:", *lines[-_SHOWN:], sep="\n")
