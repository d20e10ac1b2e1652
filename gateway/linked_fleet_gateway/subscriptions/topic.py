"""One watched resource: its present reading, the version before, and each message about it, rendered once."""

from collections.abc import Callable
from typing import Generic, Protocol

from linked_fleet_gateway.identity.rights import ALL, View
from linked_fleet_gateway.resources.message import message_body
from linked_fleet_gateway.resources.resource import Redirect, Resource
from linked_fleet_gateway.resources.template import Rendering, Versions, compiles
from linked_fleet_gateway.resources.versioning import Reading
from linked_fleet_gateway.subscriptions.broadcast import Broadcast, M
from linked_fleet_gateway.subscriptions.message import Framing, Message


class Resolver(Protocol):
    """``Tree`` as the fan-out needs it."""

    def resolve(self, path: str) -> Resource | Redirect | None: ...


class Topic(Generic[M]):
    """A resource that at least one subscriber watches, as those see it who share ``sees``.

    ``values``: whether measured values count as its change.
    """

    def __init__(self, path: str, values: bool, resource: Resource, sees: View = ALL) -> None:
        self.path, self.values, self.sees = path, values, sees
        self.watchers: dict[M, None] = {}
        self.apart: dict[M, None] = {}
        """Those of the watchers that are in no broadcast."""
        self.broadcasts: dict[tuple[str, str, Framing], Broadcast[M]] = {}
        """By media type, base and framing."""
        self.previous: str | None = None
        self.renders = 0
        self._resource = resource
        self.measured = values and resource.source.measured
        """True if a frame can be news."""
        self._resources: dict[str, Resource] = {}
        self._messages: dict[tuple[str, str], Message] = {}
        self._renderings: dict[tuple[str, str], Rendering] = {}
        self.reading: Reading = resource.source.read(values)
        self._compared: tuple[Reading | None, bool] = (None, True)

    @property
    def ended(self) -> bool:
        """True if there will be no more news of it."""
        return self._resource.source.ended()

    def replace(self, resource: Resource) -> None:
        """Take the resource as it is after its robot was described anew."""
        self._resource = resource
        self.measured = self.values and resource.source.measured
        self._resources.clear()
        self._renderings.clear()

    def refresh(self) -> bool:
        """Read the resource again; whether that was news."""
        reading = self._resource.source.read(self.values)
        if reading.same(self.reading):
            return False
        if reading.facts != self.reading.facts:
            self._renderings.clear()
        self._compared = (self.reading, True)
        self.previous, self.reading = self.reading.version, reading
        self._messages.clear()
        return True

    def differs(self, sent: Reading | None) -> bool:
        """Return True if the present reading is news to who was sent that one; mostly it is the same one for all."""
        if sent is self.reading:
            return False
        if sent is not self._compared[0]:
            self._compared = (sent, sent is None or not self.reading.same(sent))
        return self._compared[1]

    def gather(self) -> None:
        """Have those fall in that have caught up with a broadcast."""
        for watcher in list(self.apart):
            watcher.fall_in(self.path)

    def message(self, media_type: str, base: str, tree: Callable[[str, View], Resolver]) -> Message:
        """The message about the present reading; WriteError when the syntax cannot say it."""
        message = self._messages.get((media_type, base))
        if message is None:
            self.renders += 1
            body = self._body(media_type, base, tree)
            message = self._messages[media_type, base] = Message(self.path, self.reading.version, media_type, body)
        return message

    def _body(self, media_type: str, base: str, tree: Callable[[str, View], Resolver]) -> bytes:
        rendering = self._renderings.get((media_type, base))
        if rendering is None:
            resource = self._under(base, tree)
            if not (self.values and compiles(resource, media_type)):
                return message_body(resource, media_type, base, self.reading.version, self.previous)
            rendering = self._renderings[media_type, base] = Rendering(resource, media_type, base)
        return rendering.of(self.reading.observations, Versions(self.reading.version, self.previous))

    def _under(self, base: str, tree: Callable[[str, View], Resolver]) -> Resource:
        resource = self._resources.get(base)
        if resource is None:
            found = tree(base, self.sees).resolve(self.path)
            resource = self._resources[base] = found if isinstance(found, Resource) else self._resource
        return resource
