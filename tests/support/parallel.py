"""Concurrent work of tests: in threads, or on virtual time in turns of one event loop."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Protocol, TypeVar

from virtual.loop import VirtualLoop, current

T = TypeVar("T")


class Running(Protocol[T]):  # type: ignore[misc]
    """The part of ``concurrent.futures.Future`` that tests use."""

    def done(self) -> bool: ...
    def result(self) -> T: ...


class Pool(Protocol):
    """The part of ``concurrent.futures.Executor`` that tests use."""

    def submit(self, work: Callable[..., T], /, *arguments: object) -> Running[T]: ...


class _VirtualRunning:
    def __init__(self, loop: VirtualLoop, work: Callable[[], T]) -> None:
        self._loop, self._future = loop, Future[T]()

        def run() -> None:
            try:
                self._future.set_result(work())
            except BaseException as error:  # noqa: BLE001 - raised by ``result``
                self._future.set_exception(error)

        loop.start(run)

    def done(self) -> bool:
        return self._future.done()

    def result(self) -> object:
        self._loop.run_until(self._future.done, "the end of work beside the test", 3600.0)
        return self._future.result()


class _VirtualPool:
    def __init__(self, loop: VirtualLoop) -> None:
        self._loop = loop
        self.all: list[_VirtualRunning] = []

    def submit(self, work: Callable[..., T], /, *arguments: object) -> _VirtualRunning:
        self.all.append(_VirtualRunning(self._loop, lambda: work(*arguments)))
        return self.all[-1]


@contextmanager
def pool(count: int) -> Iterator[Pool]:
    """Run up to ``count`` works at once; waits at the end until all are done."""
    loop = current()
    if loop is None:
        with ThreadPoolExecutor(count) as threads:
            yield threads  # type: ignore[misc]
        return
    virtual = _VirtualPool(loop)
    yield virtual  # type: ignore[misc]
    for each in virtual.all:
        loop.run_until(each.done, "the end of work beside the test", 3600.0)


def at_once(works: list[Callable[[], T]]) -> list[T]:
    """Run all works at the same time, and return their results in order."""
    with pool(max(1, len(works))) as workers:
        return [each.result() for each in [workers.submit(work) for work in works]]
