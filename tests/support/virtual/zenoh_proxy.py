"""The connection between a gateway and robots, which the test can cut and heal."""

import contextlib
from collections.abc import Iterator
from typing import Protocol

from forwarder import proxy
from running import Process
from simulated_robots import SIMULATED
from virtual.loop import VirtualLoop, current


class ZenohProxy(Protocol):
    """``endpoint``: where robots connect. Whatever is sent while the connection is cut waits, as in TCP."""

    @property
    def endpoint(self) -> str: ...
    def cut(self) -> None: ...
    def heal(self) -> None: ...


class _InMemory:
    def __init__(self, loop: VirtualLoop, endpoint: str, node: str, robots: str) -> None:
        from virtual.processes import world  # it imports the product, for which few tests wait

        self._loop, self._nodes, self.endpoint = loop, (node, robots), endpoint
        self._network = world(loop).network((endpoint,))

    def cut(self) -> None:
        self._loop.inside(self._network.partition, *self._nodes)

    def heal(self) -> None:
        self._loop.inside(self._network.heal, *self._nodes)


@contextlib.contextmanager
def zenoh_proxy(endpoint: str, gateway: Process, robots: str = SIMULATED) -> Iterator[ZenohProxy]:
    """Yield the connection to a gateway at ``endpoint``: a TCP proxy, or the in-memory network on virtual time.

    ``robots``: the name of their node in the in-memory network.
    """
    loop = current()
    if loop is None:
        with proxy(int(endpoint.rpartition(":")[2])) as between:
            yield between
    else:
        yield _InMemory(loop, endpoint, gateway.name, robots)  # type: ignore[attr-defined]
