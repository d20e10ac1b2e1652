"""The servers on which the contract of the stores is tested: in memory on virtual time, Valkey, a cluster of Valkey.

Test modules take the fixture ``server``, and ``pytest_pyfunc_call``, by which a test may be a coroutine function.
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
    """One server, or one cluster, without data at the start of each test, and the event loop of the test."""

    @property
    def url(self) -> str: ...

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine on the loop, which stays."""

    def kill(self) -> None:
        """End it as ``kill -9`` does; what it has accepted is there when it starts again."""

    def start(self) -> None: ...

    def lasting_keys(self) -> list[str]:
        """Keys that do not expire by themselves."""

    def empty(self) -> None:
        """Have it run and hold nothing."""

    def pass_time(self, duration_s: float) -> None:
        """Let time go by for clocks that measure it and for keys that expire. Nothing may be under way."""


class Memory:
    """The server in memory. ``redis`` has its faults and ``loop`` its clock."""

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
    """Valkey servers that all tests of this process share, one after the other."""

    def __init__(self, servers: Servers, runner: asyncio.Runner) -> None:
        servers.empty()
        self.url, self.run = servers.url, runner.run
        self.kill, self.start, self.empty = servers.kill, servers.start, servers.empty
        self._servers, self._passed_s = servers, 0.0

    def lasting_keys(self) -> list[str]:
        return self._servers.lasting_keys("*")

    def pass_time(self, duration_s: float) -> None:
        """Nobody waits: clocks are set ahead, keys expire earlier. Scripts that ask for the time see none of it."""
        self._passed_s += duration_s
        self._servers.expire_earlier(duration_s)

    @contextmanager
    def clock(self) -> Iterator[None]:
        """Have the monotonic clock count the time that was passed."""
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
    """Run a test that is a coroutine function on the event loop of its ``server``."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    arguments = {name: pyfuncitem.funcargs[name] for name in names}
    pyfuncitem.funcargs["server"].run(pyfuncitem.obj(**arguments))
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
    """Run a state machine on the server, for some seconds."""
    examples = 30 if isinstance(server, Memory) else 15
    run_state_machine_as_test(
        lambda: model(server), settings=settings(max_examples=examples, stateful_step_count=steps)
    )


def opened(server: Backend, context: AbstractAsyncContextManager[T]) -> Iterator[T]:
    """Enter a context for the time of one test, as the body of a fixture."""
    with_it = AsyncExitStack()
    yield server.run(with_it.enter_async_context(context))
    server.run(with_it.aclose())
