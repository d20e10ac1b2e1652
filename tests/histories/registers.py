"""Clients that write conditionally on what they have read: settings of robots, objects, rules."""

import random
from typing import Protocol

from histories.gateways import Gateway
from histories.history import History
from histories.keys import Keys
from linked_fleet_gateway.extensions.rules.rule import Rule
from linked_fleet_gateway.extensions.rules.store import Changed as RuleChanged
from linked_fleet_gateway.extensions.world.scene import SceneObject, Sphere, decode, encode
from linked_fleet_runtime.table import Changed as ObjectChanged
from linked_fleet_runtime.table import Full, digest
from linked_fleet_state.model import Pose

_READS, _REMOVES = 0.25, 0.1
_ROBOT = "arm"


class Register(Protocol):
    """A kind of resource that is read and replaced; None stands for a missing resource."""

    kind: str
    removable: bool

    def next(self, present: str | None, label: str) -> str:
        """Return the value that replaces ``present``."""

    async def read(self, gateway: Gateway, key: str) -> str | None: ...

    async def swap(self, gateway: Gateway, key: str, expect: str | None, value: str | None) -> bool: ...


class Settings:
    kind = "setting-"
    removable = True

    def next(self, present: str | None, label: str) -> str:
        return label

    async def read(self, gateway: Gateway, key: str) -> str | None:
        return (await gateway.store.read_settings(_ROBOT)).get(key)

    async def swap(self, gateway: Gateway, key: str, expect: str | None, value: str | None) -> bool:
        return await gateway.store.set_setting(_ROBOT, key, expect, value)


class Objects:
    kind = "object-"
    removable = True

    def next(self, present: str | None, label: str) -> str:
        return label

    async def read(self, gateway: Gateway, key: str) -> str | None:
        body = await gateway.objects.read(key)
        return None if body is None else decode(body).title

    async def swap(self, gateway: Gateway, key: str, expect: str | None, value: str | None) -> bool:
        present, body = (None if each is None else _object(each) for each in (expect, value))
        try:
            await gateway.objects.change(key, digest(present), body)
        except ObjectChanged:
            return False
        return True


def _object(title: str) -> bytes:
    pose = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    return encode(SceneObject(title=title, kind="obstacle", pose=pose, geometry=Sphere(0.1)))


class Rules:
    """The value includes the revision. Ids are never reused, so a removed rule stays removed."""

    kind = "rule-"
    removable = False

    def next(self, present: str | None, label: str) -> str:
        return f"{_revision(present) + 1} {label}"

    async def read(self, gateway: Gateway, key: str) -> str | None:
        known = await gateway.rules.read(key)
        return None if known is None else f"{known.revision} {known.rule.title}"

    async def swap(self, gateway: Gateway, key: str, expect: str | None, value: str | None) -> bool:
        assert value is not None
        rule = Rule(key, value.partition(" ")[2], "", "/", "http://fleet.example", "client", 0)
        try:
            await gateway.rules.write(rule, _revision(expect), 100_000)
        except RuleChanged:
            return False
        return True


def _revision(value: str | None) -> int:
    return 0 if value is None else int(value.partition(" ")[0])


class RegisterClients:
    """Read resources, and replace what was read."""

    def __init__(self, history: History, register: Register, uses: int) -> None:
        self._history, self._register = history, register
        self._keys = Keys(history, lambda: history.label(register.kind), count=3, uses=uses)
        self._seen: dict[tuple[int, str], str | None] = {}

    async def act(self, client: int, gateway: Gateway, draws: random.Random) -> None:
        key = self._keys.pick(draws)
        if (client, key) not in self._seen or draws.random() < _READS:
            await self._read(client, gateway, key)
        else:
            await self._swap(client, gateway, key, draws)

    async def _read(self, client: int, gateway: Gateway, key: str) -> None:
        asked = self._history.asks(client, "register", key, "read")
        value = await self._register.read(gateway, key)
        asked.answered(value=value)
        self._seen[client, key] = value

    async def _swap(self, client: int, gateway: Gateway, key: str, draws: random.Random) -> None:
        present = self._seen.pop((client, key))
        removes = self._register.removable and present is not None and draws.random() < _REMOVES
        value = None if removes else self._register.next(present, self._history.label("v"))
        called = self._history.calls(client, "register", key, "swap", expect=present, value=value)
        try:
            done = await self._register.swap(gateway, key, present, value)
        except Full:
            return  # by the objects of earlier keys; nothing was written, and the operation stays unanswered
        called.answered(is_="done" if done else "changed")
        if done:
            self._seen[client, key] = value

    async def settle(self, gateway: Gateway) -> None:
        """Read every key once more after all faults."""
        for key in self._keys.all:
            await self._read(-1, gateway, key)
