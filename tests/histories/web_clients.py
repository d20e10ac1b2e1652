"""Clients of gateways over HTTP: conditional writes, control of robots, and motions with idempotency keys."""

import asyncio
import random
from collections.abc import Callable
from typing import Protocol

from commanding import PREFIXES, control, radian
from histories.history import History
from histories.keys import Keys
from histories.web import HttpGateway, last_segment, quoted
from histories.workload import Unanswered

_DURATIONS_S = (1, 2)
_STEP = 1e-6
_PATIENCE_S, _LOOK_S = 20.0, 0.1
_SPHERE = (
    "lf:position [ maths:x 9 ; maths:y 9 ; maths:z 9 ; vom:unit unit:M ] ; "
    "lf:orientation [ maths:x 0 ; maths:y 0 ; maths:z 0 ; lf:w 1 ] ; "
    "lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue 1 ; vom:unit unit:M ] ]"
)


class Kind(Protocol):
    """A kind of resource, and the predicate of its value."""

    predicate: str

    def body(self, value: str) -> str: ...


class Title:
    predicate = "lf:value"

    def body(self, value: str) -> str:
        return PREFIXES + f'<> lf:value "{value}" .'


class SceneObject:
    predicate = "dcterms:title"

    def body(self, value: str) -> str:
        return PREFIXES + f'<> a lf:Obstacle ; dcterms:title "{value}" ; {_SPHERE} .'


class ConditionalWriters:
    """Read at one gateway and write at another, conditional on the entity tag that was read."""

    def __init__(
        self, history: History, kind: Kind, make: Callable[[], str], uses: int, gateways: list[HttpGateway]
    ) -> None:
        self._history, self._kind, self._gateways = history, kind, gateways
        self._keys = Keys(history, make, count=3, uses=uses)
        self._seen: dict[tuple[int, str], tuple[str, str]] = {}

    async def act(self, client: int, gateway: HttpGateway, draws: random.Random) -> None:
        key = self._keys.pick(draws)
        if (client, key) not in self._seen:
            if (found := await self._read(gateway, key)) is not None:
                self._seen[client, key] = found
            return
        present, tag = self._seen.pop((client, key))
        value = self._history.label("v")
        # Another gateway may not know yet what was read here, or not even the robot, and refuse: a weak comparison.
        called = self._history.calls(client, "register", key, "swap", expect=present, value=value, weak=True)
        answer = await gateway.ask("PUT", key, self._kind.body(value), if_match=tag)
        called.answered(is_={204: "done", 412: "changed", 404: "changed"}[answer.status])

    async def _read(self, gateway: HttpGateway, key: str) -> tuple[str, str] | None:
        """Return value and entity tag as known by the gateway, possibly outdated.

        Return None from a gateway that has started and does not know the robot yet.
        """
        answer = await gateway.ask("GET", key)
        if answer.status == 404:
            return None
        return quoted(answer.text, self._kind.predicate), answer.headers["etag"]

    async def settle(self, gateway: HttpGateway) -> None:
        """Wait until all gateways agree on what was written last."""
        for key in self._keys.all:
            async with asyncio.timeout(_PATIENCE_S):
                while len(found := {await self._read(each, key) for each in self._gateways}) > 1 or None in found:  # noqa: ASYNC110
                    await asyncio.sleep(_LOOK_S)
            asked = self._history.asks(0, "register", key, "read")
            asked.answered(value=next(each[0] for each in found if each is not None))


class Controllers:
    """Take, use and release control of robots."""

    def __init__(self, history: History, make: Callable[[], str], uses: int) -> None:
        self._history = history
        self._keys = Keys(history, make, count=4, uses=uses)
        self._owned: dict[tuple[int, str], tuple[str, str]] = {}
        """Label and token of a lease, by client and robot."""

    async def act(self, client: int, gateway: HttpGateway, draws: random.Random) -> None:
        robot = self._keys.pick(draws)
        doing = draws.choices((self._take, self._write, self._release), (4, 4, 1))[0]
        await doing(client, gateway, robot, draws)

    def _proof(self, client: int, robot: str) -> tuple[str, dict[str, str]]:
        label, token = self._owned.get((client, robot), ("", ""))
        return label, {"lock_token": token} if token else {}

    async def _take(self, client: int, gateway: HttpGateway, robot: str, draws: random.Random) -> None:
        owned, proof = self._proof(client, robot)
        label, duration_s = self._history.label("owner"), draws.choice(_DURATIONS_S)
        called = self._history.calls(client, "lease", robot, "take", label=label, token=owned, for_=duration_s * 10**9)
        answer = await gateway.ask("PUT", f"{robot}/lease", control(label, duration_s), **proof)
        if answer.status == 409:
            called.answered(is_="held", label=answer.said("holder"))
            return
        renewed = answer.headers["lock-token"] == proof.get("lock_token")
        called.answered(is_="renewed" if renewed else "taken", label=owned if renewed else label)
        self._owned[client, robot] = owned if renewed else label, answer.headers["lock-token"]

    async def _write(self, client: int, gateway: HttpGateway, robot: str, draws: random.Random) -> None:
        """Write a setting, which only the holder of the lease may do."""
        owned, proof = self._proof(client, robot)
        asked = self._history.asks(client, "lease", robot, "act", token=owned)
        answer = await gateway.ask("PUT", f"{robot}/title", Title().body("mine"), **proof)
        if answer.status == 409:
            asked.answered(is_="held", label=answer.said("holder"))
        else:
            asked.answered(is_="allowed")

    async def _release(self, client: int, gateway: HttpGateway, robot: str, draws: random.Random) -> None:
        owned, proof = self._proof(client, robot)
        if not proof:
            return
        called = self._history.calls(client, "lease", robot, "release", token=owned)
        answer = await gateway.ask("DELETE", f"{robot}/lease", **proof)
        if answer.status == 409:
            called.answered(is_="held", label=answer.said("holder"))
        else:
            called.answered(is_={204: "released", 404: "free"}[answer.status])

    async def settle(self, gateway: HttpGateway) -> None:
        """Do nothing: leases need not end."""


class Movers:
    """Request motions, and repeat requests. Each key has a target of its own, which identifies the key of a command."""

    def __init__(self, history: History, action: str, uses: int) -> None:
        self._history, self._action = history, action
        self._keys = Keys(history, lambda: history.label("key-"), count=4, uses=uses)
        self._numbers: dict[str, int] = {}
        self._of_target: dict[float, str] = {}

    def ran(self, command: str, target: float, since_ns: int) -> None:
        """Record that the robot has begun a command."""
        self._history.happened("key", self._of_target[target], "ran", since_ns, id=command)

    async def act(self, client: int, gateway: HttpGateway, draws: random.Random) -> None:
        key = self._keys.pick(draws)
        target = round(self._numbers.setdefault(key, len(self._numbers)) * _STEP, 6)
        self._of_target[target] = key
        other = draws.random() < 0.1
        body = radian(target) + ("\n# another request" if other else "")
        called = self._history.calls(client, "key", key, "begin", digest="other" if other else "same")
        answer = await gateway.ask("POST", self._action, body, idempotency_key=key)
        if answer.status in (204, 504):
            called.answered(id=last_segment(answer.headers["location"]))
        elif answer.problem == "key-reused":
            called.answered(is_="reused")
        elif answer.problem == "refused":
            called.answered(id="?")
        else:
            raise Unanswered(answer.text)

    async def settle(self, gateway: HttpGateway) -> None:
        """Do nothing: the commands that ran are recorded as they run."""
