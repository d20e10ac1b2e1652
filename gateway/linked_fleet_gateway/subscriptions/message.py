"""Messages and outlets: a message is rendered once, framed once per channel, and shared by all."""

from collections.abc import Callable
from enum import Enum
from typing import Protocol, runtime_checkable

from msgspec import Struct, field


class Message(Struct):
    """A complete representation of one resource at one version; never modified.

    One is created for each change of each watched value: a Struct costs a fifth of a frozen dataclass.
    """

    path: str
    version: str
    """Version of the resource; also the ``id`` of an event, from which a stream resumes."""
    media_type: str
    body: bytes
    _frames: dict["Framing", bytes] = field(default_factory=dict)

    def framed(self, framing: "Framing") -> bytes:
        """Return the bytes that ``framing`` makes of this message, made once for all recipients."""
        frame = self._frames.get(framing)
        if frame is None:
            frame = self._frames[framing] = framing(self)
        return frame


Framing = Callable[[Message], bytes]


class Ending(Enum):
    """The reason why no more messages will come."""

    CANCELLED = "the subscription was deleted"
    GONE = "the resource does not exist any more"
    UNENTITLED = "the right to subscribe has ended"
    REPLACED = "the subscription was opened on another connection"
    SHUTDOWN = "the gateway is shutting down"


class Outlet(Protocol):
    """The last step of a channel. It never blocks and buffers a bounded number of bytes."""

    def writable(self) -> bool:
        """Return True if a message would leave almost at once; otherwise values are conflated."""

    def write(self, message: Message) -> None:
        """Send one message. Called only while ``writable()``; a message of any size is accepted whole."""

    def end(self, ending: Ending) -> None:
        """Close the channel; nothing is written after it."""


@runtime_checkable
class Stream(Outlet, Protocol):
    """An outlet that also accepts framed bytes, which are the same for all streams of its kind."""

    framing: Framing

    def send(self, frame: bytes) -> bool:
        """Send bytes made by ``framing`` if the stream is ``writable()``; return whether they were sent."""


class Feed(Protocol):
    """The interface of the fan-out to an outlet."""

    def ready(self) -> None:
        """Announce that the outlet can take messages, at first and whenever it has become writable again."""
