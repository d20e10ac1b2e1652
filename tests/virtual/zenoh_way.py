"""The way between a gateway and the robots that a test simulates, which the test can cut and heal."""

import contextlib
from collections.abc import Iterator
from typing import Protocol

from forwarder import way
from running import Process
from simulated import SIMULATED
from virtual.loop import VirtualLoop, current


class ZenohWay(Protocol):
    """``endpoint`` is the one at which robots connect. What is sent while it is cut waits, as with TCP."""

    @property
    def endpoint(self) -> str: ...
    def cut(self) -> None: ...
    def heal(self) -> None: ...


class _InMemory:
    def __init__(self, loop: VirtualLoop, endpoint: str, node: str) -> None:
        from virtual.processes import world  # it imports the product, for which few tests wait

        self._loop, self._node, self.endpoint = loop, node, endpoint
        self._network = world(loop).network((endpoint,))

    def cut(self) -> None:
        self._loop.inside(self._network.partition, self._node, SIMULATED)

    def heal(self) -> None:
        self._loop.inside(self._network.heal, self._node, SIMULATED)


@contextlib.contextmanager
def zenoh_way(endpoint: str, gateway: Process) -> Iterator[ZenohWay]:
    """To a gateway that listens at ``endpoint``: over TCP, or on virtual time in its network in memory."""
    loop = current()
    if loop is None:
        with way(int(endpoint.rpartition(":")[2])) as between:
            yield between
    else:
        yield _InMemory(loop, endpoint, gateway.name)  # type: ignore[attr-defined]
