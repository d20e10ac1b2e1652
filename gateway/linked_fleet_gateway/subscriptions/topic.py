"""One watched resource: its present reading, its version, and its messages, each rendered once."""

from enum import IntEnum
from typing import Generic, Protocol

from linked_fleet_gateway.resources.message_body import message_body
from linked_fleet_gateway.resources.resource import Redirect, Resource
from linked_fleet_gateway.resources.templates import Rendering, Versions, is_measured
from linked_fleet_gateway.resources.versioning import Reading
from linked_fleet_gateway.subscriptions.broadcast import Broadcast, Framing, M, Message
from linked_fleet_gateway.subscriptions.event_id import event_id, event_tag
from linked_fleet_identity.rights import ALL, View


class Resolver(Protocol):
    """The interface of ``Tree`` to a watched resource."""

    def resolve(self, path: str) -> Resource | Redirect | None: ...


class Renderer(Protocol):
    """The interface of the fan-out to a watched resource."""

    messages_rendered: int
    """Messages rendered so far."""

    def tree(self, base: str, view: View) -> Resolver:
        """Return the present tree for a base URL and a view."""


class Again(IntEnum):
    """The ways in which a watched resource is read again; each includes the ones before it."""

    OBSERVE = 1
    """Its values, because a frame has come."""
    READ = 2
    """Its facts too."""
    RESOLVE = 3
    """As it is found in the tree, because its constants, its members or its existence may have changed."""


class Topic(Generic[M]):
    """A resource with at least one subscriber, for the subscribers with one ``view``.

    ``with_values``: whether a change of measured values counts.
    """

    def __init__(self, renderer: Renderer, path: str, with_values: bool, resource: Resource, view: View = ALL) -> None:
        self.path, self.with_values, self.view = path, with_values, view
        self._renderer, self._tag = renderer, event_tag(path, with_values)
        self.watchers: dict[M, None] = {}
        self.single_watchers: dict[M, None] = {}
        """The watchers that are in no broadcast."""
        self.broadcasts: dict[tuple[str, str, Framing], Broadcast[M]] = {}
        """Broadcasts by media type, base URL and framing."""
        self.previous_version: str | None = None
        self._resource = resource
        self.measured = with_values and resource.source.is_measured
        """True if a frame can change this resource."""
        self._resources: dict[str, Resource] = {}
        self._messages: dict[tuple[str, str], Message] = {}
        self._renderings: dict[tuple[str, str], Rendering] = {}
        self.reading: Reading = resource.source.read(with_values)
        self._compared: tuple[Reading | None, bool] = (None, True)

    @property
    def is_final(self) -> bool:
        """True if the resource will not change any more."""
        return self._resource.source.is_final()

    @property
    def event_id(self) -> str:
        """The id of a message about the present reading."""
        return event_id(self.reading.version, self._tag)

    def replace_resource(self, resource: Resource) -> None:
        """Replace the resource, because its robot was described anew."""
        self._resource = resource
        self.measured = self.with_values and resource.source.is_measured
        self._resources.clear()
        self._renderings.clear()

    def refresh(self, after_frame: bool = False) -> bool:
        """Read the resource again; return True if it changed. ``after_frame``: nothing but a frame has come since."""
        before = self.reading
        reading = self._resource.source.read(self.with_values, before if after_frame else None)
        if reading.equals(before):
            return False
        if reading.facts != before.facts:
            self._renderings.clear()
        self._compared = (before, True)
        self.previous_version, self.reading = before.version, reading
        self._messages.clear()
        return True

    def differs(self, sent: Reading | None) -> bool:
        """Return True if the present reading is news to a subscriber that was sent ``sent``."""
        if sent is self.reading:
            return False
        if sent is not self._compared[0]:
            self._compared = (sent, sent is None or not self.reading.equals(sent))
        return self._compared[1]

    def join_broadcasts(self) -> None:
        """Let subscribers that have caught up join a broadcast."""
        for watcher in list(self.single_watchers):
            watcher.join_broadcast(self.path)

    def message(self, media_type: str, base: str) -> Message:
        """Return the message about the present reading; WriteError if the syntax cannot express it."""
        message = self._messages.get((media_type, base))
        if message is None:
            self._renderer.messages_rendered += 1
            body = self._body(media_type, base)
            message = Message(self.path, self.reading.version, media_type, body, self.event_id)
            self._messages[media_type, base] = message
        return message

    def _body(self, media_type: str, base: str) -> bytes:
        versions = Versions(self.reading.version, self.event_id, self.previous_version)
        rendering = self._renderings.get((media_type, base))
        if rendering is None:
            resource = self._under(base)
            if not (self.with_values and is_measured(resource, media_type)):
                return message_body(resource, media_type, base, versions)
            rendering = self._renderings[media_type, base] = Rendering(resource, media_type, base)
        return rendering.render_observations(self.reading.observations, versions)

    def _under(self, base: str) -> Resource:
        resource = self._resources.get(base)
        if resource is None:
            found = self._renderer.tree(base, self.view).resolve(self.path)
            resource = self._resources[base] = found if isinstance(found, Resource) else self._resource
        return resource
