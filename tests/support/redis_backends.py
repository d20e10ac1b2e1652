"""The servers for the contract tests of the stores: in memory on virtual time, Valkey, and a cluster of Valkey.

Test modules import the fixture ``server``, and ``pytest_pyfunc_call``, which runs coroutine functions as tests.
"""

import asyncio
import inspect
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import AbstractAsyncContextManager, AsyncExitStack, contextmanager
from typing import Any, Protocol, TypeVar
from unittest import mock

import pytest
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, run_state_machine_as_test

from redis_servers import Servers, cluster, single
from virtual.loop import VirtualLoop, virtual_time
from virtual.redis_server import RedisServer

T = TypeVar("T")
WITHIN_S = 3600.0


class Backend(Protocol):
    """A server or a cluster, empty at the start of each test, and the event loop of the test."""

    @property
    def url(self) -> str: ...

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine on the loop of the test."""

    def kill(self) -> None:
        """End the server as ``kill -9`` does; accepted data is there after the next start."""

    def start(self) -> None: ...

    def lasting_keys(self) -> list[str]:
        """Return the keys without an expiry."""

    def empty(self) -> None:
        """Start the server if necessary, and delete all data."""

    def pass_time(self, duration_s: float) -> None:
        """Let time pass for monotonic clocks and expiring keys. No operation may be in progress."""


class Memory:
    """The server in memory. ``redis`` sets its faults, ``loop`` has its clock."""

    def __init__(self, loop: VirtualLoop) -> None:
        self.loop, self.redis = loop, RedisServer(loop.internet)
        self.url = self.redis.url
        self.kill, self.start = self.redis.unreachable, self.redis.reachable

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        return self.loop.run(work, WITHIN_S)

    def lasting_keys(self) -> list[str]:
        return self.redis.keys(lasting=True)

    def empty(self) -> None:
        self.redis.lose_everything()

    def pass_time(self, duration_s: float) -> None:
        self.loop.run_for(duration_s)


class Real:
    """Valkey servers shared by the tests of this process, one test at a time."""

    def __init__(self, servers: Servers, runner: asyncio.Runner) -> None:
        servers.empty()
        self.url, self.run = servers.url, runner.run
        self.kill, self.start, self.empty = servers.kill, servers.start, servers.empty
        self._servers, self._passed_s = servers, 0.0

    def lasting_keys(self) -> list[str]:
        return self._servers.lasting_keys("*")

    def pass_time(self, duration_s: float) -> None:
        """Advance clocks and expiries without waiting. Scripts that ask Redis for the time do not notice."""
        self._passed_s += duration_s
        self._servers.expire_earlier(duration_s)

    @contextmanager
    def clock(self) -> Iterator[None]:
        """Add the passed time to the monotonic clock."""
        real = time.monotonic
        with mock.patch.object(time, "monotonic", lambda: real() + self._passed_s):
            yield


@pytest.fixture(params=["memory", "valkey", pytest.param("valkey_cluster", marks=pytest.mark.test_all)])
def server(request: pytest.FixtureRequest) -> Iterator[Backend]:
    if request.param == "memory":
        with virtual_time() as loop:
            yield Memory(loop)
    else:
        with asyncio.Runner() as runner:
            real = Real(request.getfixturevalue(request.param), runner)
            with real.clock():
                yield real


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a coroutine function as a test, on the event loop of its ``server``."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj) or "server" not in pyfuncitem.funcargs:
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    arguments = {name: pyfuncitem.funcargs[name] for name in names}
    server: Any = pyfuncitem.funcargs["server"]
    server.run(pyfuncitem.obj(**arguments))
    return True


@pytest.fixture(scope="session")
def valkey(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with single(tmp_path_factory.mktemp("valkey")) as servers:
        yield servers


@pytest.fixture(scope="session")
def valkey_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with cluster(tmp_path_factory.mktemp("cluster")) as servers:
        yield servers


def hold_to(model: Callable[[Backend], RuleBasedStateMachine], server: Backend, steps: int) -> None:
    """Run a state machine against the server, for some seconds."""
    examples = 30 if isinstance(server, Memory) else 15
    run_state_machine_as_test(
        lambda: model(server), settings=settings(max_examples=examples, stateful_step_count=steps)
    )


def opened(server: Backend, context: AbstractAsyncContextManager[T]) -> Iterator[T]:
    """Enter a context for one test, as the body of a fixture."""
    with_it = AsyncExitStack()
    yield server.run(with_it.enter_async_context(context))
    server.run(with_it.aclose())
