"""The Zenoh session of the ROS 2 driver: its node in the ROS graph, over rmw_zenoh, zenoh-bridge-ros2dds or both.

Apart from zenoh_session.py, no other module of the agent imports zenoh. Callbacks of the session only put bytes into
bounded queues, and tokens into a bounded table; the driver looks at both on its own thread.
"""

import asyncio
import secrets
import threading
import time
from collections.abc import Callable, Collection
from contextlib import ExitStack
from typing import Any, NamedTuple

import zenoh
from zenoh import ext

from linked_fleet_agent.robots.ros2.graph import MAX_OFFERS, CallError, Interface, Mailbox, Offer, Outlet, Role
from linked_fleet_agent.robots.ros2.transports import (
    GID_BYTES,
    KEEP_LAST_ONE,
    LATCHED,
    DdsBridge,
    RmwZenoh,
    Transport,
    attachment,
    is_bridge,
)
from linked_fleet_agent.zenoh_session import configuration

_LEASE_MS = 2_000
_LONGEST_CALL_S = 86_400.0
_MOST_KEYS = 8
"""Most keys on which one topic is published: definitions of its type by the transports."""


class _Subscription(NamedTuple):
    topic: Interface
    box: Mailbox
    latched: bool


class RosSession:
    """One node of ROS with a Zenoh session of its own: a client of ``endpoint``, which is a router or a bridge.

    It speaks rmw_zenoh unless ``bridge_only``, and joins the DDS side too as soon as a bridge is there. ``hash_of``
    gives the hash (REP 2016) of a type by its name. Zenoh reconnects and renews the declarations by itself. Raises
    ConnectionError if the endpoint does not answer.
    """

    def __init__(
        self, endpoint: str, domain: int, node: str, hash_of: Callable[[str], str], bridge_only: bool = False
    ) -> None:
        config = configuration((endpoint,), (), _LEASE_MS)
        config.insert_json5("timestamping/enabled", "true")  # lets late joiners tell cached messages from newer ones
        try:
            self._session: Any = zenoh.open(config)
        except zenoh.ZError as error:
            raise ConnectionError(str(error).partition(" at /")[0]) from error
        self._declared, self._hash_of, self._number = ExitStack(), hash_of, 0
        self._rmw = None if bridge_only else RmwZenoh(domain, str(self._session.info.zid()), node)
        self._bridge = DdsBridge()
        self._transports: list[Transport] = []
        self._subscriptions: list[_Subscription] = []
        self._joining = threading.RLock()
        self._sender = _Sender()
        self._heard = _Tokens(self._join_bridge)
        if self._rmw is not None:
            self._keep(self._session.liveliness().declare_token(self._rmw.node_token))
            self._listen_to_tokens(self._rmw)
            self._join(self._rmw)
        self._listen_to_tokens(self._bridge)
        if bridge_only:
            self._join(self._bridge)

    @property
    def version(self) -> int:
        return self._heard.version

    @property
    def is_bridged(self) -> bool:
        """True if zenoh-bridge-ros2dds is, or was, there."""
        return self._heard.has_bridge

    def offers(self) -> Collection[Offer]:
        return self._heard.offers()

    def subscribe(self, topic: Interface, longest: int, most: int = 32, latched: bool = False) -> Mailbox:
        """Subscribe on every transport, also one that comes later."""
        subscription = _Subscription(topic, Mailbox(longest, most), latched)
        with self._joining:
            self._subscriptions.append(subscription)
            for transport in self._transports:
                self._subscribe(transport, subscription)
        self._show("subscription", topic, LATCHED if latched else KEEP_LAST_ONE)
        return subscription.box

    def outlet(self, topic: Interface) -> Outlet:
        """Return a publisher that drops messages under congestion."""
        self._show("publisher", topic, KEEP_LAST_ONE)
        return _Outlet(self, topic)

    async def call(self, service: Interface, request: bytes, longest: int) -> bytes:
        """Call a service. Raises CallError, at once if no node offers it."""
        ended: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        offered = self._heard.keys("service", service)
        if not offered:
            raise CallError(f"no node offers the service {service.name}")
        key, transport = next(iter(offered.items()))
        cancellation: Any = zenoh.CancellationToken()
        try:
            self._session.get(
                key,
                _until_reply(ended, service.name, longest),
                payload=request,
                attachment=self._sender.attachment() if transport.attaches else None,
                timeout=_LONGEST_CALL_S,
                consolidation=zenoh.ConsolidationMode.NONE,
                cancellation_token=cancellation,
            )
            return await ended
        except zenoh.ZError as error:
            raise CallError(f"{service.name} was not called: {error}"[:300]) from error
        finally:
            cancellation.cancel()

    def close(self) -> None:
        """Leave the ROS graph. May be called again."""
        with self._joining:
            self._transports.clear()
            self._declared.close()
            self._session.close()

    def keys_of(self, topic: Interface) -> dict[str, Transport]:
        """Return the keys of a topic: of its subscribers, and with the own definition of its type."""
        own = {each.key(topic, self._hash_of(topic.type)): each for each in self._transports}
        return {**own, **self._heard.keys("subscription", topic)}

    def declare_publisher(self, key: str) -> Any:
        made = self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP, express=True)
        self._keep(made)
        return made

    def _listen_to_tokens(self, transport: Transport) -> None:
        hear = zenoh.handlers.Callback(self._heard.listener(transport), indirect=False)
        self._keep(self._session.liveliness().declare_subscriber(transport.tokens, hear, history=True))

    def _join_bridge(self) -> None:
        """Join the DDS side, in a thread: callbacks of Zenoh must not declare anything."""
        with self._joining:
            if self._transports and self._bridge not in self._transports:
                self._join(self._bridge)
                self._heard.version += 1

    def _join(self, transport: Transport) -> None:
        self._transports.append(transport)
        for subscription in self._subscriptions:
            self._subscribe(transport, subscription)

    def _subscribe(self, transport: Transport, to: _Subscription) -> None:
        key, take = transport.key(to.topic, ""), _into(to.box)
        if to.latched:
            history = ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
            self._keep(ext.declare_advanced_subscriber(self._session, key, take, history=history))
        else:
            # In the thread of Zenoh that receives: one more thread would wake up for each message.
            self._keep(self._session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False)))

    def _show(self, role: Role, topic: Interface, quality: str) -> None:
        """Announce a part of the node to other nodes of rmw_zenoh. A bridge needs no announcement."""
        if self._rmw is not None:
            self._number += 1
            token = self._rmw.token(self._number, role, topic, self._hash_of(topic.type), quality)
            self._keep(self._session.liveliness().declare_token(token))

    def _keep(self, declared: Any) -> None:
        self._declared.callback(declared.undeclare)


class _Tokens:
    """The announcements in the tokens of other nodes, with the keys. Zenoh fills it from a thread of its own."""

    def __init__(self, join_bridge: Callable[[], None]) -> None:
        self._join_bridge = join_bridge
        self._offers: dict[str, tuple[Transport, tuple[Offer, ...]]] = {}
        self._listed: tuple[Offer, ...] | None = None
        self._lock = threading.Lock()
        self.version, self.has_bridge = 0, False

    def listener(self, transport: Transport) -> Callable[[zenoh.Sample], None]:
        """Return a callback that notes tokens of the transport."""

        def take(sample: zenoh.Sample) -> None:
            token = str(sample.key_expr)
            if is_bridge(token) and not self.has_bridge:
                self.has_bridge = True
                threading.Thread(target=self._join_bridge, daemon=True).start()
            self._note(token, transport, sample.kind == zenoh.SampleKind.PUT)

        return take

    def offers(self) -> tuple[Offer, ...]:
        """Return what is announced, each once; made anew when a token has come or gone."""
        with self._lock:
            if self._listed is None:
                self._listed = tuple(dict.fromkeys(offer for _, offers in self._offers.values() for offer in offers))
            return self._listed

    def keys(self, role: Role, interface: Interface) -> dict[str, Transport]:
        """Return the keys under which other nodes have the interface in this role, with their transport."""
        with self._lock:
            return {
                transport.key(interface, offer.key_hash): transport
                for transport, offers in self._offers.values()
                for offer in offers
                if (offer.role, offer.interface) == (role, interface)
            }

    def _note(self, token: str, transport: Transport, alive: bool) -> None:
        offers = transport.offers_of(token)
        with self._lock:
            if not alive:
                self._offers.pop(token, None)
            elif offers and (token in self._offers or len(self._offers) < MAX_OFFERS):
                self._offers[token] = transport, offers
            self._listed = None
            self.version += 1


class _Sender:
    """The sender of messages or requests, which rmw_zenoh numbers."""

    def __init__(self) -> None:
        self._gid, self._sequence = secrets.token_bytes(GID_BYTES), 0

    def attachment(self) -> bytes:
        """Return the attachment of the next one."""
        self._sequence += 1
        return attachment(self._sequence, time.time_ns(), self._gid)


class _Outlet:
    """A publisher of one topic, on the keys of all its subscribers."""

    def __init__(self, session: RosSession, topic: Interface) -> None:
        self._session, self._topic, self._version = session, topic, -1
        self._publishers: dict[str, tuple[Any, bool]] = {}
        self._sender = _Sender()

    @property
    def has_subscribers(self) -> bool:
        return any(publisher.matching_status.matching for publisher, _ in self._current())

    def put(self, payload: bytes) -> None:
        """Publish without waiting. Raises zenoh.ZError if the session is closed."""
        said = self._sender.attachment()
        for publisher, attaches in self._current():
            publisher.put(payload, attachment=said if attaches else None)

    def _current(self) -> Collection[tuple[Any, bool]]:
        if self._version != self._session.version:
            self._version = self._session.version
            for key, transport in self._session.keys_of(self._topic).items():
                if key not in self._publishers and len(self._publishers) < _MOST_KEYS:
                    self._publishers[key] = self._session.declare_publisher(key), transport.attaches
        return self._publishers.values()


def _into(box: Mailbox) -> Callable[[zenoh.Sample], None]:
    """Return a callback that puts samples into the box. Zenoh calls it in a thread of its own."""

    def take(sample: zenoh.Sample) -> None:
        fits = len(sample.payload) <= box.longest
        box.put(sample.payload.to_bytes() if fits else None)

    return take


def _until_reply(ended: "asyncio.Future[bytes]", name: str, longest: int) -> Any:
    """Return a handler that settles ``ended`` on its event loop by the first reply, or when there will be none."""
    loop = ended.get_loop()

    def settle(payload: bytes | None, why: str) -> None:
        if ended.done():
            return
        if payload is None:
            ended.set_exception(CallError(f"{name} {why}"))
            ended.exception()  # nobody waits for it any more if the agent has ended meanwhile
        else:
            ended.set_result(payload)

    def later(payload: bytes | None, why: str = "") -> None:
        if not loop.is_closed():
            loop.call_soon_threadsafe(settle, payload, why)

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is None:
            later(None, "answered with an error of Zenoh")
        elif len(reply.ok.payload) > longest:
            later(None, f"answered with {len(reply.ok.payload)} bytes; {longest} is the maximum")
        else:
            later(reply.ok.payload.to_bytes())

    return zenoh.handlers.Callback(take, lambda: later(None, "did not answer"), indirect=False)
