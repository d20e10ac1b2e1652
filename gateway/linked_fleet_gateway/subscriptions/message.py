"""Messages and outlets: a message is rendered once, framed once per channel, and shared by all."""

from collections.abc import Callable
from enum import Enum
from typing import Protocol, runtime_checkable

from msgspec import Struct, field


class Message(Struct):
    """A complete representation of one resource at one version of it; nobody changes it.

    One is made for each change of each value that is watched: this costs a fifth of what a frozen dataclass does.
    """

    path: str
    version: str
    """The version of the resource; also the ``id`` of an event, and what a stream is resumed by."""
    media_type: str
    body: bytes
    _frames: dict["Framing", bytes] = field(default_factory=dict)

    def framed(self, framing: "Framing") -> bytes:
        """The bytes that ``framing`` makes of this message, made once for all who get it."""
        frame = self._frames.get(framing)
        if frame is None:
            frame = self._frames[framing] = framing(self)
        return frame


Framing = Callable[[Message], bytes]


class Ending(Enum):
    """Why no more messages will come."""

    CANCELLED = "the subscription was deleted"
    GONE = "the resource does not exist any more"
    UNENTITLED = "the right to subscribe has ended"
    REPLACED = "the subscription was opened on another connection"
    SHUTDOWN = "the gateway is shutting down"


class Outlet(Protocol):
    """The last step of a channel. It never blocks and never keeps more than a bounded number of bytes."""

    def writable(self) -> bool:
        """Return True if a message would leave without much waiting; while it would not, values are conflated."""

    def write(self, message: Message) -> None:
        """Send one message. Called only while ``writable()``; a message of any size is taken whole."""

    def end(self, ending: Ending) -> None:
        """Close the channel; nothing is written after it."""


@runtime_checkable
class Stream(Outlet, Protocol):
    """An outlet to which messages can be brought as bytes that are the same for all streams of its kind."""

    framing: Framing

    def send(self, frame: bytes) -> bool:
        """Send what ``framing`` made, whole, if the stream is ``writable()``; whether it was."""


class Feed(Protocol):
    """The interface of the fan-out to an outlet."""

    def ready(self) -> None:
        """To be called when the outlet can take messages, at first and whenever it has become writable again."""
