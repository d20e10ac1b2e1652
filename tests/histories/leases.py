"""Clients that take control leases of robots, act with and without them, and release them."""

import random
from dataclasses import dataclass

from histories.gateways import Gateway
from histories.history import History
from histories.keys import Keys
from linked_fleet_gateway.actions.store import LeaseHeld, LeaseNotHeld

_MODEL = "lease"
_DURATIONS_S = (0.03, 0.1, 0.4)


@dataclass
class _Owned:
    """A lease that a client has or had. ``label``: its holder, who takes only one lease."""

    label: str
    id: str
    token: str


class LeaseClients:
    def __init__(self, history: History, uses: int) -> None:
        self._history = history
        self._keys = Keys(history, lambda: history.label("robot-"), count=3, uses=uses)
        self._owned: dict[tuple[int, str], _Owned] = {}

    async def act(self, client: int, gateway: Gateway, draws: random.Random) -> None:
        robot = self._keys.pick(draws)
        doing = draws.choices((self._take, self._act, self._tied, self._release, self._look), (4, 3, 1, 1, 1))[0]
        await doing(client, gateway, robot, draws)

    def _token(self, client: int, robot: str) -> _Owned:
        return self._owned.get((client, robot)) or _Owned("", "", "")

    async def _take(self, client: int, gateway: Gateway, robot: str, draws: random.Random) -> None:
        owned, label = self._token(client, robot), self._history.label("owner")
        duration_s = draws.choice(_DURATIONS_S)
        called = self._history.calls(
            client, _MODEL, robot, "take", label=label, token=owned.label, for_=round(duration_s * 1e9)
        )
        try:
            lease, token = await gateway.store.take_lease(robot, label, duration_s, owned.token)
        except LeaseHeld as held:
            called.answered(is_="held", label=held.lease.holder)
            return
        called.answered(is_="taken" if lease.holder == label else "renewed", label=lease.holder)
        self._owned[client, robot] = _Owned(lease.holder, lease.id, token)

    async def _act(self, client: int, gateway: Gateway, robot: str, draws: random.Random) -> None:
        """Begin a motion, with the control lease or without."""
        await self._check(client, gateway, robot, "act", tied=False)

    async def _tied(self, client: int, gateway: Gateway, robot: str, draws: random.Random) -> None:
        if self._token(client, robot).label:
            await self._check(client, gateway, robot, "tied", tied=True)

    async def _check(self, client: int, gateway: Gateway, robot: str, do: str, *, tied: bool) -> None:
        owned = self._token(client, robot)
        asked = self._history.asks(client, _MODEL, robot, do, token=owned.label)
        try:
            await gateway.store.check_lease(robot, owned.token, owned.id if tied else "")
        except LeaseHeld as held:
            asked.answered(is_="held", label=held.lease.holder)
        except LeaseNotHeld:
            asked.answered(is_="free")
        else:
            asked.answered(is_="tied" if tied else "allowed")

    async def _release(self, client: int, gateway: Gateway, robot: str, draws: random.Random) -> None:
        owned = self._token(client, robot)
        called = self._history.calls(client, _MODEL, robot, "release", token=owned.label)
        try:
            released = await gateway.store.release_lease(robot, owned.token)
        except LeaseHeld as held:
            called.answered(is_="held", label=held.lease.holder)
        else:
            called.answered(is_="released" if released else "free")

    async def _look(self, client: int, gateway: Gateway, robot: str, draws: random.Random) -> None:
        asked = self._history.asks(client, _MODEL, robot, "look")
        lease = await gateway.store.read_lease(robot)
        asked.answered(is_="free") if lease is None else asked.answered(is_="held", label=lease.holder)

    async def settle(self, gateway: Gateway) -> None:
        """Do nothing: leases need not end."""
