"""Subscriptions of one robot to the liveliness tokens and heartbeats of gateways."""

import asyncio
import logging
import time
from collections.abc import Callable
from contextlib import ExitStack

from linked_fleet_agent.gateways import MAX_GATEWAYS, Gateways
from linked_fleet_agent.renewal import Renewal
from linked_fleet_agent.transport import Session
from linked_fleet_agent.wire.keys import Keys

_log = logging.getLogger(__name__)

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
            self._gateways.appeared(gateway, now_s)
            self._renewal.appeared(gateway, now_s)
            self._subscribe(gateway, max(0.0, self._left_s + _SETTLE_S - now_s))
        else:
            self._gateways.left(gateway, now_s)
            self._renewal.left(gateway, now_s)
            self._heartbeats.pop(gateway, ExitStack()).close()
            self._left_s = now_s

    def _subscribe(self, gateway: str, delay_s: float) -> None:
        if gateway in self._heartbeats or len(self._heartbeats) >= MAX_GATEWAYS:
            return
        kept = self._heartbeats[gateway] = ExitStack()

        def subscribe() -> None:
            kept.enter_context(self._session.subscribe(self._keys.heartbeat(gateway), hear))

        def hear(_: str) -> None:
            self._gateways.heard(gateway, time.monotonic())

        kept.callback(asyncio.get_running_loop().call_later(delay_s, subscribe).cancel)
