"""Events of requests: what clients have executed, or what was refused although its resource was found."""

from collections.abc import Callable

from msgspec import Struct

from linked_fleet_base.faults import Faults


class RequestEvent(Struct, frozen=True):
    """A request other than a read, the begin or end of a stream, or what an extension does in the name of a client."""

    client: str
    """Name of the caller; without identities the network address."""
    event: str
    """The method, ``subscribe`` or ``unsubscribe``, or a word of the extension."""
    path: str
    robot: str = ""
    """The robot that the path is of, if any."""
    status: int | None = None
    """Status of the response; None for the end of a stream."""
    request: str = ""
    """Id of the request."""
    created: str = ""
    """Path of the created invocation or subscription, if any."""
    reason: str = ""
    """The reason of a refusal or failure: the detail of the problem, its beginning if that is long."""
    by_page: bool = False
    """True for what a page does by itself: the subscriptions to what it shows, and renewals of control."""


Listener = Callable[[RequestEvent], None]


class RequestEvents:
    """Tells listeners. An error of one of them is a fault, and does not concern the request."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self.listeners: dict[Listener, str] = {}
        """Their names in faults."""

    def tell(self, event: RequestEvent) -> None:
        for listener, name in self.listeners.items():
            with self._faults.guard("listeners", thing=name):
                listener(event)
