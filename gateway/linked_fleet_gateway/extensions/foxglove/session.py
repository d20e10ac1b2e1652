"""One client: its subscriptions and its requests, which become internal HTTP requests to this gateway."""

import asyncio
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import suppress

import msgspec

from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.api import SubprotocolConnection, ask, cancel_tasks, time_sliced
from linked_fleet_gateway.extensions.foxglove import protocol
from linked_fleet_gateway.extensions.foxglove.catalogue import SPEED, Catalogue, may_see
from linked_fleet_gateway.extensions.foxglove.protocol import (
    Call,
    Channel,
    Parameter,
    Request,
    Service,
    UnsupportedMessage,
)
from linked_fleet_gateway.serving import ConnectionEnded, Reply, ReplyTooLong

MOST_CALLS = 8
"""Calls and settings of one client in progress, not counting the same number of calls that stop."""
ERROR = 2
_AT_ONCE = 100  # channels in one message
_TOO_MANY = "Too many calls are in progress; wait for their responses."
_FIELDS = {"content-type": "application/json", "accept": "application/json"}


class Session:
    """A client's session. ``subscribed`` are channels by subscription id, ``told`` is the last state sent by channel.

    ``rewatch`` is called when the subscriptions change.
    """

    def __init__(self, conversation: SubprotocolConnection, catalogue: Catalogue, rewatch: Callable[[], None]) -> None:
        self.conversation = conversation
        self.subscribed: dict[int, int] = {}
        self.told: dict[int, bytes] = {}
        self.news = asyncio.Event()
        self._caller, self._catalogue, self._rewatch = conversation.websocket.caller, catalogue, rewatch
        self._seen = defaultdict[str, set[int]](set)
        self._followed: dict[str, Parameter | None] = {}
        self._calls: dict[asyncio.Task[None], bool] = {}
        self._under_way = set[tuple[int, int]]()
        self._setting = asyncio.Lock()

    def sees(self, robot: str) -> bool:
        """Return True if the client may know of a robot."""
        return may_see(self._caller, robot)

    async def run(self) -> None:
        """Serve the client until it disconnects. Raises ConnectionEnded."""
        info = {"name": "Linked Fleet", "capabilities": protocol.CAPABILITIES, "supportedEncodings": [protocol.JSON]}
        await self._say("serverInfo", **info, sessionId=f"{id(self):x}")
        telling = asyncio.create_task(_until_ended(self._tell()), name="advertise to a Foxglove client")
        try:
            while True:
                await self._take(await self.conversation.receive())
        finally:
            await cancel_tasks([telling, *self._calls])

    async def _say(self, op: str, **said: object) -> None:
        await self.conversation.send(protocol.text(op, **said))

    async def _tell(self) -> None:
        """Advertise channels, services and parameters as they change."""
        while True:
            self.news.clear()
            await self._advertise("advertise", "unadvertise", "channels", "channelIds", self._catalogue.channels)
            services = self._catalogue.services
            await self._advertise("advertiseServices", "unadvertiseServices", "services", "serviceIds", services)
            found = self._parameters() if self._followed else {}
            changed = {name: each for name, last in self._followed.items() if (each := found.get(name, last)) != last}
            if changed:
                self._followed |= changed
                await self._say("parameterValues", parameters=list(changed.values()))
            await self.news.wait()

    async def _advertise(
        self, new: str, gone: str, member: str, ids: str, all: Mapping[int, Channel] | Mapping[int, Service]
    ) -> None:
        base = self.conversation.websocket.base
        found = {id: each for id, each in all.items() if may_see(self._caller, each.robot)}
        seen = self._seen[member]
        if left := seen - found.keys():
            seen -= left
            await self._say(gone, **{ids: sorted(left)})
        fresh = sorted(found.keys() - seen)
        for ids_now in (fresh[at : at + _AT_ONCE] for at in range(0, len(fresh), _AT_ONCE)):
            portion = [
                found[id].advertisement(base) async for id in time_sliced(ids_now)
            ]  # the schema of a service takes time
            seen.update(ids_now)
            await self._say(new, **{member: portion})

    def _parameters(self) -> dict[str, Parameter]:
        return self._catalogue.parameters(self._caller)

    async def _take(self, message: str | bytes) -> None:
        try:
            request = protocol.parse(message)
            await (self._call(request) if isinstance(request, Call) else self._do(request))
        except UnsupportedMessage as error:
            await self._say("status", level=ERROR, message=str(error))

    async def _do(self, request: Request) -> None:
        names = dict.fromkeys(request.parameter_names)
        match request.op:
            case "subscribe":
                self._subscribe(request.subscriptions)
            case "unsubscribe":
                self._unsubscribe(request.subscription_ids)
            case "getParameters":
                await self._get(names, request.id)
            case "setParameters":
                self._begin_setting(request)
            case "subscribeParameterUpdates":
                self._follow(names)
            case "unsubscribeParameterUpdates":
                self._followed = {name: each for name, each in self._followed.items() if name not in names}

    def _subscribe(self, wanted: Iterable[protocol.SubscriptionRequest]) -> None:
        wrong, taken, seen = [], set(self.subscribed.values()), self._seen["channels"]
        for each in wanted:
            if each.channel_id not in seen or each.channel_id in taken or each.id in self.subscribed:
                wrong.append(each.channel_id)
                continue
            self.subscribed[each.id] = each.channel_id
            self.told.pop(each.channel_id, None)
            taken.add(each.channel_id)
        self._rewatch()
        if wrong:
            raise UnsupportedMessage(f"There are no such channels, or they are subscribed to already: {wrong[:10]}.")

    def _unsubscribe(self, ids: Iterable[int]) -> None:
        wrong = [id for id in ids if self.subscribed.pop(id, None) is None]
        self._rewatch()
        if wrong:
            raise UnsupportedMessage(f"There are no such subscriptions: {wrong[:10]}.")

    def _follow(self, names: Iterable[str]) -> None:
        present = self._parameters().keys()
        self._followed |= {name: None for name in names if name in present}
        self.news.set()
        if wrong := [name for name in names if name not in present]:
            raise UnsupportedMessage(f"There are no such parameters: {wrong[:10]}"[:300])

    async def _get(self, names: Iterable[str], id: str | None) -> None:
        found = self._parameters()
        wanted = [found[name] for name in names if name in found] if names else list(found.values())
        await self._say("parameterValues", parameters=wanted, **({} if id is None else {"id": id}))

    def _begin_setting(self, request: Request) -> None:
        """Apply the settings in the background, because a stop must not wait for them."""
        present, names = self._parameters(), dict.fromkeys(each.name for each in request.parameters)
        if wrong := [name for name in names if name not in present or not name.endswith(f"/{SPEED}")]:
            raise UnsupportedMessage(f"There are no such parameters that can be set: {wrong[:10]}"[:300])
        if not self._has_room(stops=False):
            raise UnsupportedMessage(_TOO_MANY)
        self._begin(self._set(request, names), "set parameters", stops=False)

    async def _set(self, request: Request, names: Iterable[str]) -> None:
        """Apply the settings one after the other, then answer with the resulting values."""
        async with self._setting:
            for each in request.parameters:
                reply = await self._ask("PUT", each.name, msgspec.json.encode({"value": {"value": each.value}}))
                if isinstance(reply, str):
                    await self._say("status", level=ERROR, message=f"{each.name}: {reply}")
            await self._get(names, request.id)

    async def _call(self, call: Call) -> None:
        service = self._catalogue.services.get(call.service) if call.service in self._seen["services"] else None
        if service is None:
            await self._fail(call, "There is no such service.")
        elif call.encoding != protocol.JSON:
            await self._fail(call, f"Services take {protocol.JSON}, not {call.encoding[:40]!r}.")
        elif not self._has_room(service.stops):
            await self._fail(call, _TOO_MANY)
        elif not service.stops and (service.id, call.id) in self._under_way:
            # a failure would be taken for that of the call under way
            raise UnsupportedMessage(f"The id {call.id} is that of a call under way of this service; take another one.")
        else:
            task = self._begin(self._answer(service, call), f"call of {service.offer.path}", service.stops)
            self._under_way.add((service.id, call.id))
            task.add_done_callback(lambda _: self._under_way.discard((service.id, call.id)))

    def _has_room(self, stops: bool) -> bool:
        return sum(each == stops for each in self._calls.values()) < MOST_CALLS

    def _begin(self, work: Awaitable[None], name: str, stops: bool) -> asyncio.Task[None]:
        task = asyncio.create_task(_until_ended(work), name=name)
        self._calls[task] = stops
        task.add_done_callback(self._calls.pop)
        return task

    async def _fail(self, call: Call, message: str) -> None:
        await self._say("serviceCallFailure", serviceId=call.service, callId=call.id, message=message)

    async def _answer(self, service: Service, call: Call) -> None:
        reply = await self._ask("POST", service.offer.path, b"" if service.stops else call.content or b"{}")
        if isinstance(reply, str):
            await self._fail(call, reply)
            return
        said = {"status": reply.status, "invocation": reply.headers.get("location", "")}
        await self.conversation.send(protocol.response(call, said))

    async def _ask(self, method: str, path: str, content: bytes) -> Reply | str:
        """Return the gateway's response to a request of this client, or a sentence that says why it was refused."""
        try:
            reply = await ask(self.conversation.websocket, method, path, fields=_FIELDS, content=content)
        except (FleetError, ReplyTooLong) as error:
            return str(error)
        return reply if reply.status < 400 else f"{reply.status}: {reply.problem.get('detail', 'refused')}"


async def _until_ended(work: Awaitable[None]) -> None:
    """Await ``work``; ignore the error of a disconnected client, because the session detects it itself."""
    with suppress(ConnectionEnded):
        await work
