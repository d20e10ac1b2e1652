"""A ROS graph as the driver uses it: topics, services and what other nodes offer, whatever the transport.

``session.py`` has the real one, on Zenoh. Payloads are CDR (XTypes 1.3, 7.4.3), which ``types.py`` reads and writes.
"""

import time
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

MAX_OFFERS = 4096
"""Most entities of other nodes that are remembered, so that a hostile node costs a bounded amount of memory."""
Role = Literal["publisher", "subscription", "service", "client"]


@dataclass(frozen=True)
class Interface:
    """A topic, service or action by its full name, such as ``/joint_states``, and its type.

    The type is written as in ``sensor_msgs/msg/JointState``, ``std_srvs/srv/Trigger`` or
    ``control_msgs/action/FollowJointTrajectory``.
    """

    name: str
    type: str


class Offer(NamedTuple):
    """A part of another node: a publisher or subscription of a topic, a server or client of a service.

    An action is known by its parts, as ``/NAME/_action/send_goal``. ``latched`` publishers keep messages for late
    joiners (transient local). The hash (REP 2016) is empty where the transport does not tell it, as in Humble;
    ``key_hash`` is what keys have of it.
    """

    role: Role
    interface: Interface
    type_hash: str = ""
    latched: bool = False
    key_hash: str = ""


class ReceivedMessage(NamedTuple):
    """A message and its arrival in monotonic seconds; the payload is None if it was too long."""

    payload: bytes | None
    at_s: float


class Mailbox:
    """The last ``most`` messages of one topic, of up to ``longest`` bytes; unfetched older ones are dropped."""

    def __init__(self, longest: int, most: int) -> None:
        self.longest = longest
        self._waiting: deque[ReceivedMessage] = deque(maxlen=most)

    def put(self, payload: bytes | None, at_s: float | None = None) -> None:
        """Store a message; None is one that was too long. May be called from any thread."""
        self._waiting.append(ReceivedMessage(payload, time.monotonic() if at_s is None else at_s))

    @property
    def newest(self) -> ReceivedMessage | None:
        """The last message that is not fetched yet."""
        return self._waiting[-1] if self._waiting else None

    def fetch(self) -> list[ReceivedMessage]:
        """Return the messages since the last call, oldest first."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))] if self._waiting else []


class CallError(Exception):
    """A service was not called, or has not answered; the message says why, and what was not answered."""


class Outlet(Protocol):
    """A publisher of one topic."""

    @property
    def has_subscribers(self) -> bool:
        """True if a subscriber is known."""

    def put(self, payload: bytes) -> None:
        """Publish without waiting."""


class Graph(Protocol):
    """One node of the driver in a ROS graph. All methods are called on the event loop of the agent."""

    @property
    def version(self) -> int:
        """A number that changes with the offers."""

    def offers(self) -> Collection[Offer]:
        """Return what the other nodes have now."""

    def subscribe(self, topic: Interface, longest: int, most: int = 32, latched: bool = False) -> Mailbox:
        """Subscribe to messages of up to ``longest`` bytes. ``latched`` fetches earlier ones too (transient local)."""

    def outlet(self, topic: Interface) -> Outlet:
        """Return a publisher of the topic."""

    async def call(self, service: Interface, request: bytes, longest: int) -> bytes:
        """Call a service, and return its response of up to ``longest`` bytes. Wait as long as the caller does.

        The transport may end the wait, after five seconds or more. Raises CallError.
        """

    def close(self) -> None:
        """Leave the graph. May be called again."""
