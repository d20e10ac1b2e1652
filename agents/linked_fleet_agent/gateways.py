"""The gateways that an agent knows of, and the renewal of its Zenoh declarations.

``GatewayWatch`` subscribes for one robot to the liveliness tokens and heartbeats of gateways. ``Gateways`` derives from
them which gateways are alive, in the running time of this agent. ``Renewal`` decides when the robot declares its Zenoh
resources again. ``Gateways`` and ``Renewal`` are pure: time is passed in.

Routers whose connection breaks and returns within a tenth of a second may not exchange their declarations again (Zenoh
1.10). Then a gateway does not see a robot, or a robot a gateway, until the declarations are renewed. The robot cannot
tell this from a gateway that has ended: it only sees that tokens of gateways go and come.
"""

import asyncio
import logging
import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

from linked_fleet_agent.transport import Session
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.transport import GATEWAY_LEASE_MS

_log = logging.getLogger(__name__)

LEASE_S = GATEWAY_LEASE_MS / 1000.0
# An event loop that is late by more than this was paused, with its process or with the whole machine.
PAUSE_S = 0.25
# Zenoh reconnects within this time after a process was starved or paused for longer than a lease.
GRACE_S = 0.5
# Bounds the memory that tokens of unknown gateways can take.
MAX_GATEWAYS = 256


@dataclass
class _Gateway:
    heard_s: float
    """Time of the last heartbeat. The token counts as the first one."""
    until_s: float = math.inf
    """The time until which the gateway counts after its token has gone; infinite while the token exists."""
    beats: bool = False
    alive: bool = True


class Gateways:
    """The gateways that one robot knows.

    A gateway is alive while its token exists and its last heartbeat is at most ``LEASE_S`` old. Ages are measured in
    running time of this agent's event loop: a pause counts as ``PAUSE_S`` at most, because heartbeats sent meanwhile
    could not be received. Zenoh also closes a connection that was silent because a process was paused, and reconnects
    at once. So a gateway whose token has gone counts for another ``GRACE_S``, or ``LEASE_S`` if this agent was paused,
    but never longer than its last heartbeat allows.
    """

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._known: dict[str, _Gateway] = {}
        self._arrivals = 0
        self._period_s = 0.0
        self._now_s: float | None = None
        self._ran_s = 0.0
        self._resumed_s = -math.inf

    @property
    def present(self) -> bool:
        """True if at least one gateway is alive."""
        return any(gateway.alive for gateway in self._known.values())

    @property
    def arrivals(self) -> int:
        """Number of gateways that have appeared so far; a gateway that returns or resumes counts again."""
        return self._arrivals

    def record_arrival(self, name: str, now_s: float) -> None:
        """Record the token of a gateway. Its first heartbeat is due within one lease."""
        self._advance(now_s)
        if name not in self._known and len(self._known) < MAX_GATEWAYS:
            self._known[name] = _Gateway(self._ran_s)
        gateway = self._known.get(name)
        if gateway is not None:
            if gateway.until_s < math.inf:
                _log.info("%s: the connection to gateway %s is back", self._robot, name)
            gateway.until_s = math.inf
            self._arrivals += 1

    def record_departure(self, name: str, now_s: float) -> None:
        """Record that the token of a gateway has gone."""
        self._advance(now_s)
        gateway = self._known.get(name)
        if gateway is None:
            return
        if not gateway.alive:
            del self._known[name]
        elif gateway.until_s == math.inf:
            grace_s = LEASE_S if self._ran_s - self._resumed_s <= LEASE_S else GRACE_S
            gateway.until_s = self._ran_s + grace_s
            _log.info("%s: the connection to gateway %s is lost; it has %g s to come back", self._robot, name, grace_s)

    def record_heartbeat(self, name: str, now_s: float) -> None:
        """Record a heartbeat. It is ignored if the gateway has no token."""
        self._advance(now_s)
        gateway = self._known.get(name)
        if gateway is None:
            return
        if not gateway.alive:
            _log.warning("%s: gateway %s sends heartbeats again", self._robot, name)
            self._arrivals += 1
        gateway.heard_s, gateway.beats, gateway.alive = self._ran_s, True, True

    def watch(self, now_s: float, period_s: float) -> None:
        """Update which gateways are alive. The event loop calls this every ``period_s`` seconds."""
        self._period_s = period_s
        self._advance(now_s)
        for name, gateway in list(self._known.items()):
            if self._ran_s > gateway.until_s:
                del self._known[name]
            elif gateway.alive and self._ran_s - gateway.heard_s > LEASE_S:
                gateway.alive = False
                _log.warning("%s: gateway %s %s", self._robot, name, _silence(gateway))

    def _advance(self, now_s: float) -> None:
        gap_s = 0.0 if self._now_s is None else now_s - self._now_s
        self._now_s = now_s
        self._ran_s += min(gap_s, self._period_s + PAUSE_S)
        if gap_s > self._period_s + PAUSE_S:
            self._resumed_s = self._ran_s


def _silence(gateway: _Gateway) -> str:
    if gateway.beats:
        return f"sent no heartbeat for {LEASE_S:g} s: it hangs, or its machine is overloaded"
    return (
        "has a token but sends no heartbeat: it hangs, its version sends none, or a router blocks them "
        '("Trust" in PROTOCOL.md)'
    )


RENEW_S = 5.0
"""Delay from the last such event to the renewal. It doubles while a gateway is missing."""
LONGEST_S = 60.0
FORGOTTEN_S = 3600.0
"""A gateway that has been gone for this long no longer counts as missing."""
MAX_MISSING = 256


class Renewal:
    """Renewal times of a robot that starts at ``now_s``. A gateway that has departed is missing until it arrives."""

    def __init__(self, now_s: float) -> None:
        self._settled_s = now_s + RENEW_S
        self._missing: dict[str, float] = {}
        self._alive = False
        self._wait_s, self._due_s = RENEW_S, math.inf

    def record_arrival(self, gateway: str, now_s: float) -> None:
        missing = self._missing.pop(gateway, None) is not None
        if missing or (not self._alive and now_s >= self._settled_s):
            self._begin(now_s)

    def record_departure(self, gateway: str, now_s: float) -> None:
        if len(self._missing) < MAX_MISSING:
            self._missing[gateway] = now_s
        self._begin(now_s)

    def due(self, now_s: float, alive: bool) -> bool:
        """Return True if the robot must renew its declarations now. Call it periodically.

        ``alive`` says that some gateway is alive. While none is, renewals are scheduled as while one is missing.
        """
        self._alive = alive
        if not alive and self._due_s == math.inf and now_s >= self._settled_s:
            self._begin(now_s)
        if now_s < self._due_s:
            return False
        self._missing = {name: left_s for name, left_s in self._missing.items() if now_s < left_s + FORGOTTEN_S}
        self._wait_s = min(2 * self._wait_s, LONGEST_S)
        self._due_s = now_s + self._wait_s if self._missing or not alive else math.inf
        return True

    def _begin(self, now_s: float) -> None:
        self._wait_s, self._due_s = RENEW_S, now_s + RENEW_S


# Delay after the token of a gateway has gone. A router tells its peers only about the first subscriber of a key. After
# this delay all agents behind one router have unsubscribed, so it announces the next subscriber.
_SETTLE_S = 0.5


class GatewayWatch:
    """Subscribes to the heartbeats of a gateway while its token exists.

    ``declare_anew`` is called when the robot must undeclare its presence and queryables and declare them again.
    """

    def __init__(self, session: Session, keys: Keys, robot: str, declare_anew: Callable[[], None]) -> None:
        self._session, self._keys, self._robot, self._declare_anew = session, keys, robot, declare_anew
        self._gateways, self._renewal = Gateways(robot), Renewal(time.monotonic())
        self._declared = ExitStack()
        self._heartbeats: dict[str, ExitStack] = {}
        self._left_s = -_SETTLE_S
        self._closed = False

    @property
    def present(self) -> bool:
        return self._gateways.present

    @property
    def arrivals(self) -> int:
        return self._gateways.arrivals

    def declare(self) -> None:
        self._declared.enter_context(self._session.subscribe_tokens(self._keys.all_gateways, self._note_token))

    def close(self) -> None:
        self._closed = True
        for declared in (self._declared, *self._heartbeats.values()):
            declared.close()

    def check(self, period_s: float) -> None:
        """Check which gateways are alive. The event loop calls this every ``period_s`` seconds."""
        now_s = time.monotonic()
        self._gateways.watch(now_s, period_s)
        if self._renewal.due(now_s, self._gateways.present):
            _log.debug("%s: renews its Zenoh declarations", self._robot)
            self._declare_anew()

    def _note_token(self, key: str, present: bool) -> None:
        try:
            gateway, now_s = self._keys.gateway_of(key), time.monotonic()
        except ValueError as error:
            _log.debug("%s: ignored: %s", self._robot, error)
            return
        if self._closed:
            return
        if present:
            self._gateways.record_arrival(gateway, now_s)
            self._renewal.record_arrival(gateway, now_s)
            self._subscribe(gateway, max(0.0, self._left_s + _SETTLE_S - now_s))
        else:
            self._gateways.record_departure(gateway, now_s)
            self._renewal.record_departure(gateway, now_s)
            self._heartbeats.pop(gateway, ExitStack()).close()
            self._left_s = now_s

    def _subscribe(self, gateway: str, delay_s: float) -> None:
        if gateway in self._heartbeats or len(self._heartbeats) >= MAX_GATEWAYS:
            return
        kept = self._heartbeats[gateway] = ExitStack()

        def subscribe() -> None:
            kept.enter_context(self._session.subscribe(self._keys.heartbeat(gateway), hear))

        def hear(_: str) -> None:
            self._gateways.record_heartbeat(gateway, time.monotonic())

        kept.callback(asyncio.get_running_loop().call_later(delay_s, subscribe).cancel)
