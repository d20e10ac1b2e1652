"""A Zenoh network in memory, on the running event loop alone: no threads, no sockets, and only the time of the loop.

Each agent has one connection to each gateway, instead of the routers between clients and gateways. Gateways do not see
each other, and agents see one another through the gateways to which they are connected. Nothing is forwarded: a
partition between an agent and one gateway is not healed by another gateway.

Like the real Zenoh (``tests/link/test_contract.py`` tests both):

- Within a connection, messages of one priority arrive in order, each once. Messages of other priorities and of other
  connections may overtake. Declarations have a queue of their own: a token may vanish before the last frame arrives.
- Droppable publications are lost at random (``loss``), and if too much waits for a peer that is cut off. Everything
  else arrives as long as the connection lasts. What is in transit when it ends is lost and not repeated.
- A cut connection delivers nothing. If it heals within the lease, everything that waited arrives; otherwise each end
  gives up by itself: tokens of the other side vanish, and questions to it end. Agents then connect again, and
  everything still declared is announced again: a token that stayed is seen to vanish and to appear.
- A reconnection neither repeats nor reorders publications.

Unlike Zenoh, a reliable publisher never blocks here, and all messages that a killed process sent arrive, although Zenoh
may have kept some in its batches.
"""

import asyncio
from collections.abc import Container, Iterator, Mapping
from contextvars import Context
from itertools import product
from random import Random

from linked_fleet_agent.wire.transport import GATEWAY_LEASE_MS
from linked_fleet_link.transport import Opener
from virtual.zenoh_agent import AgentSession
from virtual.zenoh_connection import Connection, Faults
from virtual.zenoh_gateway import GatewaySession
from virtual.zenoh_sessions import Session


class ZenohNetwork:
    """Sessions by the name of their node, which may be killed, cut off from others, and opened again.

    Everything random is seeded with ``seed``: latencies within ``latency_s``, losses with the probability ``loss``, and
    the time within ``retry_s`` after which agents connect again.
    """

    def __init__(
        self,
        seed: int = 0,
        latency_s: tuple[float, float] = (0.001, 0.001),
        loss: float = 0.0,
        retry_s: tuple[float, float] = (0.2, 1.0),
    ) -> None:
        self.random = Random(seed)
        self._faults, self._retry_s = Faults(self.random, latency_s, loss), retry_s
        self._gateways: dict[GatewaySession, str] = {}
        self._agents: dict[AgentSession, str] = {}
        self._connections: dict[tuple[GatewaySession, AgentSession], Connection] = {}
        self._cuts: set[frozenset[str]] = set()

    def gateway(self, node: str, lease_s: float = GATEWAY_LEASE_MS / 1000) -> Opener:
        """Return the argument of ``create_app``, which opens sessions of a gateway at this node for any endpoints."""

        async def open_session(
            listen: tuple[str, ...], connect: tuple[str, ...], trust: Mapping[str, object]
        ) -> GatewaySession:
            session = GatewaySession(lease_s, connects=bool(connect))
            self._gateways[session] = node
            delay_s = self.random.uniform(*self._faults.latency_s) if connect else None  # to the router of all agents
            for agent in self._agents:
                self._connect_later(session, agent, delay_s)
            return session

        return open_session

    def agent(self, node: str, lease_s: float = 2.0) -> AgentSession:
        """Open a session of an agent at this node at once; a client of Zenoh is open only when it is ``met``."""
        session = AgentSession(lease_s)
        self._agents[session] = node
        for gateway in self._gateways:
            self._connect_later(gateway, session, self.random.uniform(*self._faults.latency_s))
        return session

    # -- faults -------------------------------------------------------------------------------------------------------

    def set_faults(self, latency_s: tuple[float, float] = (0.001, 0.001), loss: float = 0.0) -> None:
        """Set the faults of all that is sent from now on."""
        self._faults.latency_s, self._faults.loss = latency_s, loss

    def partition(self, one: str, other: str) -> None:
        """Cut two nodes off from each other."""
        self._cuts.add(frozenset((one, other)))
        for connection in self._between(one, other):
            connection.cut()

    def heal(self, one: str, other: str) -> None:
        self._cuts.discard(frozenset((one, other)))
        for connection in self._between(one, other):
            connection.heal()
        for gateway, agent in product(self._gateways, self._agents):
            if {self._gateways[gateway], self._agents[agent]} == {one, other}:
                self._connect_later(gateway, agent)

    def lose_declarations(self, one: str, other: str, of: Container[str]) -> None:
        """Break and restore the connection of two nodes, without the declarations of the nodes ``of``.

        Routers of Zenoh 1.10 behave like this if both happens within a tenth of a second.
        """
        for connection in self._between(one, other):
            sessions = [session for session in self._at(one, other) if connection in session.known]
            for session in sessions:
                session.forget_all(connection)
            for session in sessions:
                if {**self._gateways, **self._agents}[session] not in of:  # type: ignore[dict-item]
                    session.announce_all(connection)

    def kill(self, node: str, silently: bool = False) -> None:
        """End the sessions of a node at once: its connections are closed, as by the kernel for a killed process.

        ``silently``: without telling anybody, like a machine without power, so that others wait for the lease.
        """
        for session in self._at(node):
            session.end(silently)

    # -- connections --------------------------------------------------------------------------------------------------

    def _at(self, *nodes: str) -> Iterator[Session]:
        everybody: dict[Session, str] = {**self._gateways, **self._agents}
        return iter([session for session, node in everybody.items() if session.alive and node in nodes])

    def _between(self, one: str, other: str) -> list[Connection]:
        return [
            connection
            for (gateway, agent), connection in self._connections.items()
            if {self._gateways[gateway], self._agents[agent]} == {one, other}
        ]

    def _connect_later(self, gateway: GatewaySession, agent: AgentSession, delay_s: float | None = None) -> None:
        delay_s = self.random.uniform(*self._retry_s) if delay_s is None else delay_s
        asyncio.get_running_loop().call_later(delay_s, self._connect, gateway, agent, context=Context())

    def _connect(self, gateway: GatewaySession, agent: AgentSession) -> None:
        cut = frozenset((self._gateways[gateway], self._agents[agent])) in self._cuts
        if gateway.alive and agent.alive and not cut and (gateway, agent) not in self._connections:
            over = lambda _: self._lose(gateway, agent)  # noqa: E731
            self._connections[gateway, agent] = Connection(gateway, agent, self._faults, over)

    def _lose(self, gateway: GatewaySession, agent: AgentSession) -> None:
        del self._connections[gateway, agent]
        if gateway.alive and agent.alive:
            self._connect_later(gateway, agent)
