"""Virtual time and in-memory connections behave like real ones, and runs are reproducible."""

import asyncio
import contextlib
import threading
import time
from collections.abc import AsyncIterator, Iterator
from datetime import UTC

import httpx
import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket as Accepted
from websockets.exceptions import ConnectionClosed, InvalidStatus

from parallel import pool
from virtual.client import Connection, WebSocket, clients_in_memory
from virtual.clock import Datetime
from virtual.loop import NothingHappens, VirtualLoop, on_virtual_time, virtual_time
from virtual.tcp import Listener


def test_an_hour_goes_by_at_once_and_all_clocks_agree() -> None:
    with virtual_time() as loop:
        began = time.monotonic(), time.time(), loop.time()
        loop.run(asyncio.sleep(3600), 4000)
        assert [time.monotonic() - began[0], time.time() - began[1], loop.time() - began[2]] == pytest.approx(
            [3600] * 3
        )
    assert time.time() < began[1], "the real clock is back"


def test_a_year_goes_by_and_short_timers_still_ring() -> None:
    with virtual_time() as loop:
        loop.run(asyncio.sleep(365 * 86_400), 400 * 86_400)
        for _ in range(100):
            loop.run(asyncio.sleep(0.001))


def test_sleeping_in_the_test_lets_timers_of_the_loop_ring_in_their_order() -> None:
    rung = []
    with virtual_time() as loop:
        for number in (3, 1, 2):
            loop.call_later(number, rung.append, number)
        time.sleep(2.5)
        assert rung == [1, 2]


def test_nothing_left_to_happen_is_said_at_once() -> None:
    with virtual_time() as loop, pytest.raises(NothingHappens):
        loop.run_until_complete(loop.create_future())


def test_asyncio_run_runs_in_the_loop_beside_all_else() -> None:
    async def main() -> float:
        await asyncio.sleep(60)
        return asyncio.get_running_loop().time()

    rung = []
    with virtual_time() as loop:
        loop.call_later(59, rung.append, 59)
        assert asyncio.run(main()) == loop.time()
        assert rung == [59]


def test_a_library_that_reads_datetime_may_be_given_one_of_the_virtual_clock() -> None:
    with virtual_time():
        assert Datetime.now(UTC).timestamp() == time.time()


def test_an_exception_of_a_callback_fails_the_test() -> None:
    with pytest.raises(AssertionError, match="in callbacks"), virtual_time() as loop:
        loop.call_soon(lambda: 1 / 0)
        loop.run_for(0.1)


def test_threads_are_inline_and_what_they_raise_is_raised() -> None:
    async def test() -> None:
        assert await asyncio.to_thread(lambda: 5) == 5
        with pytest.raises(ZeroDivisionError):
            await asyncio.to_thread(lambda: 1 / 0)

    on_virtual_time(test)


def test_a_thread_that_an_earlier_test_left_sleeps_in_real_time() -> None:
    """It neither ends nor resumes the test of the thread that is in charge."""
    ended = list[bool]()

    def work() -> None:
        time.sleep(0.01)
        ended.append(True)

    with virtual_time() as loop:
        before_s = loop.time()
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        loop.run_for(1.0)
        assert (ended, loop.time()) == ([True], before_s + 1.0)


def test_a_child_process_is_awaited_in_real_time_while_the_clock_stands_still() -> None:
    async def test() -> None:
        before = time.monotonic()
        child = await asyncio.create_subprocess_exec("cat", stdin=-1, stdout=-1)
        said, _ = await child.communicate(b"hello")
        assert said == b"hello"
        assert time.monotonic() - before < 0.1

    on_virtual_time(test)


def test_time_goes_by_while_a_child_process_is_asked_nothing() -> None:
    async def test() -> None:
        child = await asyncio.create_subprocess_exec("cat", stdin=-1, stdout=-1)
        assert child.stdin is not None and child.stdout is not None
        for _ in range(2):
            before = time.monotonic()
            child.stdin.write(b"hello\n")
            assert await child.stdout.readline() == b"hello\n"
            assert time.monotonic() - before < 0.1
            await asyncio.sleep(3600)
        child.stdin.close()
        assert await child.wait() == 0
        await asyncio.sleep(3600)

    on_virtual_time(test, 20_000)


# -- connections ----------------------------------------------------------------------------------------------------


async def hello(request: Request) -> Response:
    return PlainTextResponse(f"{request.method} {(await request.body()).decode()}")


async def ticks(request: Request) -> Response:
    async def body() -> AsyncIterator[bytes]:
        for number in range(3):
            yield b"%d\n" % number
            await asyncio.sleep(60)

    return StreamingResponse(body())


async def echo(websocket: Accepted) -> None:
    await websocket.accept()
    with contextlib.suppress(Exception):
        while True:
            await websocket.send_text(await websocket.receive_text())


async def refuse(websocket: Accepted) -> None:
    await websocket.close()


@pytest.fixture
def served() -> Iterator[tuple[VirtualLoop, int]]:
    routes = [
        Route("/", hello, methods=["GET", "POST"]), Route("/ticks", ticks),
        WebSocketRoute("/echo", echo), WebSocketRoute("/no", refuse),
    ]  # fmt: skip
    with virtual_time() as loop, clients_in_memory(loop):
        listener = Listener(loop.internet)
        config = uvicorn.Config(Starlette(routes=routes), lifespan="off", log_config=None, ws="websockets-sansio")
        server = uvicorn.Server(config)
        serving = loop.create_task(server.serve([listener]))  # type: ignore[list-item]
        loop.run_until(lambda: server.started)
        yield loop, listener.port
        server.should_exit = True
        loop.run(serving)


def test_requests_are_answered_on_one_kept_connection(served: tuple[VirtualLoop, int]) -> None:
    _loop, port = served
    with httpx.Client() as http:
        root = f"http://127.0.0.1:{port}/"
        assert [http.get(root).text, http.post(root, content=b"x" * 300_000).text[:6]] == ["GET ", "POST x"]
        (connection,) = http._transport._pool.connections  # type: ignore[attr-defined]
        assert connection.is_idle()


def test_a_stream_comes_as_time_goes_by(served: tuple[VirtualLoop, int]) -> None:
    _loop, port = served
    with httpx.Client(timeout=100) as http, http.stream("GET", f"http://127.0.0.1:{port}/ticks") as response:
        began = time.monotonic()
        assert [(line, round(time.monotonic() - began)) for line in response.iter_lines()] == [
            ("0", 0), ("1", 60), ("2", 120),
        ]  # fmt: skip


def test_a_read_times_out_after_virtual_time(served: tuple[VirtualLoop, int]) -> None:
    _loop, port = served
    with (
        httpx.Client(timeout=5) as http,
        http.stream("GET", f"http://127.0.0.1:{port}/ticks") as response,
        pytest.raises(httpx.ReadTimeout),
    ):
        list(response.iter_lines())


def test_nothing_listens_where_nobody_began_to(served: tuple[VirtualLoop, int]) -> None:
    _loop, port = served
    with httpx.Client() as http, pytest.raises(httpx.ConnectError):
        http.get(f"http://127.0.0.1:{port + 1}/")


def test_websockets_are_opened_echoed_closed_and_refused(served: tuple[VirtualLoop, int]) -> None:
    loop, port = served
    with WebSocket(loop, f"ws://127.0.0.1:{port}/echo") as websocket:
        websocket.send("hello")
        assert websocket.recv() == "hello"
        with pytest.raises(TimeoutError):
            websocket.recv(timeout=1)
        websocket.close()
        with pytest.raises(ConnectionClosed):
            websocket.recv()
    with pytest.raises(InvalidStatus):
        WebSocket(loop, f"ws://127.0.0.1:{port}/no")


def test_a_websocket_that_was_reset_is_closed_without_a_word(served: tuple[VirtualLoop, int]) -> None:
    loop, port = served
    with WebSocket(loop, f"ws://127.0.0.1:{port}/echo") as websocket:
        websocket._connection.transport._other.abort()
        loop.run_for(0.1)


class _Endless(asyncio.Protocol):
    """Writes until the transport pauses it."""

    def __init__(self) -> None:
        self.paused = False
        self.written = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        self.go_on()

    def go_on(self) -> None:
        while not self.paused and self.written < 1_000_000:
            self.written += 1000
            self.transport.write(b"x" * 1000)  # type: ignore[attr-defined]

    def pause_writing(self) -> None:
        self.paused = True

    def resume_writing(self) -> None:
        self.paused = False
        self.go_on()


def test_a_slow_reader_pauses_the_writer_and_loses_nothing() -> None:
    with virtual_time() as loop:
        protocol = _Endless()
        port = loop.internet.listen(lambda: protocol)
        connection = Connection.open(loop, "127.0.0.1", port, 1, receive_bytes=10_000)
        loop.run_for(1)
        assert protocol.paused
        assert protocol.written < 100_000
        read = 0
        while read < 1_000_000:
            read += len(connection.read(50_000, 1))
        assert (read, protocol.written) == (1_000_000, 1_000_000)


@pytest.mark.parametrize("end", ["close", "abort"])
def test_the_end_of_a_connection_is_seen_at_the_other_end(end: str) -> None:
    with virtual_time() as loop:
        protocol = _Endless()
        protocol.written = 999_000  # one piece is left
        port = loop.internet.listen(lambda: protocol)
        connection = Connection.open(loop, "127.0.0.1", port, 1)
        loop.run_for(0.1)
        getattr(protocol.transport, end)()
        assert connection.read(2000, 1) == b"x" * 1000
        if end == "close":
            assert connection.read(2000, 1) == b""
        else:
            with pytest.raises(ConnectionResetError):
                connection.read(2000, 1)


def test_a_connection_that_was_cut_carries_nothing_until_it_is_healed() -> None:
    with virtual_time() as loop:
        protocol = _Endless()
        protocol.written = 1_000_000
        port = loop.internet.listen(lambda: protocol)
        connection = Connection.open(loop, "127.0.0.1", port, 1)
        transport = protocol.transport
        transport.silent = True  # type: ignore[attr-defined]
        transport.write(b"later")  # type: ignore[attr-defined]
        with pytest.raises(TimeoutError):
            connection.read(10, 5)
        transport.release()  # type: ignore[attr-defined]
        assert connection.read(10, 5) == b"later"


# -- processes ------------------------------------------------------------------------------------------------------


def test_a_stopped_process_does_nothing_until_it_goes_on() -> None:
    with virtual_time() as loop:
        one, ticked = loop.confine("one"), []

        async def tick() -> None:
            while True:
                ticked.append(time.monotonic())
                await asyncio.sleep(1)

        task = one.run(loop.create_task, tick())
        loop.run_for(2.5)
        one.stop()
        loop.run_for(10)
        assert len(ticked) == 3
        one.go_on()
        loop.run_for(1.5)
        assert len(ticked) == 5
        task.cancel()


def test_a_killed_process_runs_no_more_and_its_connections_are_reset() -> None:
    with virtual_time() as loop:
        one, cleaned = loop.confine("one"), []
        endless = _Endless()
        endless.written = 1_000_000
        port = one.run(loop.internet.listen, lambda: endless)

        async def work() -> None:
            try:
                await asyncio.sleep(3600)
            finally:
                cleaned.append(True)

        one.run(loop.create_task, work())
        connection = Connection.open(loop, "127.0.0.1", port, 1)
        one.kill()
        with pytest.raises(ConnectionResetError):
            connection.read(10, 5)
        with pytest.raises(ConnectionRefusedError):
            Connection.open(loop, "127.0.0.1", port, 1)
        assert not cleaned


def test_the_wall_clock_of_one_process_is_stepped_for_its_tasks_alone() -> None:
    with virtual_time() as loop:
        one, read = loop.confine("one"), []

        async def look() -> None:
            await asyncio.sleep(1)
            read.append(await asyncio.to_thread(time.time))

        for run in (one.run, lambda call, *arguments: call(*arguments)):
            run(loop.create_task, look())
        one.step_wall(-3600)
        loop.run_for(2)
        assert [each - time.time() for each in read] == [-3601, -1]


def test_work_beside_the_test_has_its_moments_while_the_test_sleeps() -> None:
    with virtual_time() as loop, pool(1) as workers:
        begin = loop.time()

        def late() -> float:
            time.sleep(1)
            return loop.time() - begin

        working = workers.submit(late)
        time.sleep(100)
        assert working.done()
        assert working.result() == pytest.approx(1)
