"""Clients that create, list and delete callback subscriptions while the resources change."""

import asyncio
import contextlib
import random
import time
import uuid

from histories.gateways import Deliveries, Gateway, Watched
from histories.history import History, Operation
from linked_fleet_gateway.resources.subscription import Kind, Subscription

_MODEL = "subscription"
_OWNERS = 3
_MOST = 8  # of one owner at once
_PATIENCE_S, _LOOK_S = 20.0, 0.02


class CallbackClients:
    def __init__(self, history: History, watched: Watched, deliveries: Deliveries) -> None:
        self._history, self._watched, self._deliveries = history, watched, deliveries
        self._ids: dict[str, list[str]] = {f"/toy/owner{number}": [] for number in range(_OWNERS)}
        """Requested subscriptions by owner, until a client is told that they are gone."""
        self._paths: dict[str, str] = {}
        self._accepted: set[str] = set()
        self._deleted: set[str] = set()

    async def act(self, client: int, gateway: Gateway, draws: random.Random) -> None:
        owner = draws.choice(list(self._ids))
        draw, count = draws.random(), len(self._ids[owner])
        if draw < 0.6:
            self._watched.advance(draws.choice(self._watched.paths))
        elif draw < 0.75:
            await self._list(client, gateway, owner)
        elif not count or (draw < 0.93 and count < _MOST):
            await self._create(client, gateway, owner, draws)
        else:
            await self._delete(client, gateway, owner, draws.choice(self._ids[owner]))

    async def _create(self, client: int, gateway: Gateway, owner: str, draws: random.Random) -> None:
        id, path = str(uuid.UUID(int=draws.getrandbits(128), version=4)), draws.choice(self._watched.paths)
        self._paths[id] = path
        self._ids[owner].append(id)
        called = self._history.calls(client, _MODEL, id, "create")
        subscription = Subscription(
            id, owner, path, Kind.CALLBACK, "text/turtle", "http://fleet.example", "192.0.2.7", time.time_ns(),
            callback=f"http://receiver.example/{id}",
        )  # fmt: skip
        # "Not created" becomes true eventually: the gateway, if it lives, removes what it may have stored.
        removing = self._history.calls(client, _MODEL, id, "delete")
        await gateway.subscriptions.callbacks.create(subscription)
        removing.never_was()
        called.answered(is_="there")
        self._accepted.add(id)

    async def _list(self, client: int, gateway: Gateway, owner: str) -> None:
        """Each subscription is recorded separately, because a list is not of a single moment."""
        asked = {id: self._history.asks(client, _MODEL, id, "list") for id in self._ids[owner]}
        listed = {record.subscription.id for record in await gateway.subscriptions.records_of_owner(owner)}
        self._answer(asked, listed)

    @staticmethod
    def _answer(asked: dict[str, Operation], listed: set[str]) -> None:
        for id, each in asked.items():
            each.answered(is_="there" if id in listed else "none")

    async def _delete(self, client: int, gateway: Gateway, owner: str, id: str) -> None:
        self._deleted.add(id)
        called = self._history.calls(client, _MODEL, id, "delete")
        there = await gateway.subscriptions.cancel(id)
        called.answered(is_="there" if there else "none")
        if id in self._ids[owner]:
            self._ids[owner].remove(id)

    async def settle(self, gateway: Gateway) -> None:
        """Wait until each accepted, undeleted callback has been sent the final value."""
        for path in self._watched.paths:
            self._watched.advance(path)
        lasting = sorted(self._accepted - self._deleted)
        with contextlib.suppress(TimeoutError):  # the history then shows what is missing
            async with asyncio.timeout(_PATIENCE_S):
                while not all(map(self._is_up_to_date, lasting)):  # noqa: ASYNC110 - depends on what receivers saw
                    await asyncio.sleep(_LOOK_S)
        for owner in self._ids:
            await self._list(-1, gateway, owner)
        for id in lasting:
            rank = self._watched.rank(self._paths[id])
            self._history.happened("callback", id, "settled", self._history.now_ns(), rank=rank)

    def _is_up_to_date(self, id: str) -> bool:
        return self._deliveries.last.get(id) == self._watched.rank(self._paths[id])
