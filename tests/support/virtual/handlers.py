"""Request handlers of ``socketserver`` in memory, on virtual time."""

import contextlib
from collections.abc import Callable
from typing import Any

from virtual.client import Connection, MemorySocket
from virtual.loop import VirtualLoop
from virtual.tcp import Listener


def handling(loop: VirtualLoop, handler: Callable[..., object], server: object) -> Listener:
    """Listen, and let ``handler`` serve each connection beside the test, as ``ThreadingTCPServer`` does."""

    class Accepted(Connection):
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            loop.start(self.serve)

        def serve(self) -> None:
            with contextlib.suppress(OSError):  # clients may disconnect
                handler(MemorySocket(self, None), self.transport.get_extra_info("peername"), server)
            self.close()

    listener = Listener(loop.internet)
    listener.begin(lambda: Accepted(loop))
    return listener
