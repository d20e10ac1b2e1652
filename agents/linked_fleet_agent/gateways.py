"""Liveness of gateways from tokens and heartbeats, measured in the running time of this agent.

Pure: time is passed in.
"""

import logging
import math
from dataclasses import dataclass

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

    def appeared(self, name: str, now_s: float) -> None:
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

    def left(self, name: str, now_s: float) -> None:
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

    def heard(self, name: str, now_s: float) -> None:
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
        if gap_s > LEASE_S:
            _log.warning("%s: the agent did not run for %.1f s: it or the machine was paused", self._robot, gap_s)


def _silence(gateway: _Gateway) -> str:
    if gateway.beats:
        return f"sent no heartbeat for {LEASE_S:g} s: it hangs, or the machine has no time for it"
    return (
        "is there and sends no heartbeat: it hangs, is older than heartbeats are, or a router lets none "
        'through ("Trust" in PROTOCOL.md)'
    )
