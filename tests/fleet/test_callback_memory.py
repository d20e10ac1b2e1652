"""Accepted callbacks survive their gateway and the Redis server that stores them."""

import contextlib
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from browser import LF
from gateway_group import arrived, deliveries, gateway, gateways, hub
from receivers import receiving
from redis_servers import Server, Servers
from running import eventually, free_port
from subscribers import Socket

pytestmark = pytest.mark.virtual


def test_a_gateway_that_was_killed_serves_its_callbacks_again(tmp_path: Path) -> None:
    """With the embedded server, after SIGKILL and after a regular end."""
    port, count = free_port(), 5
    with hub() as stage, receiving() as receiver:
        paths = [f"/{index}" for index in range(count)]
        with gateway(stage, port=port, state=tmp_path) as first:
            made = [first.subscribed(receiver.url(path)) for path in paths]
            for path in paths:
                stage.step()
                arrived(receiver, path, stage.angle)
            for _ in range(50):
                stage.step()
            first.process.send(signal.SIGKILL)
            first.process.ended()
        for _ in range(10):
            stage.step()
        with gateway(stage, port=port, state=tmp_path) as second:
            for path in paths:
                arrived(receiver, path, stage.angle)
            for _ in range(10):
                stage.step()
            for path in paths:
                arrived(receiver, path, stage.angle)
                deliveries(receiver.log(path))
            assert second.listed() == {second.get(iri).url.path for iri in made}
            for iri in made:
                assert second.in_state(iri, LF.active).one(LF.failures).toPython() == "0"
        with gateway(stage, port=port, state=tmp_path) as third:
            stage.step()
            for path in paths:
                arrived(receiver, path, stage.angle)
                deliveries(receiver.log(path))
            assert len(third.listed()) == count


def kill(server: Server) -> None:
    server.kill()


def terminate(server: Server) -> None:
    """Terminate a server as an operator does, with a regular end."""
    server.ask("SHUTDOWN")
    server.kill()


@pytest.mark.parametrize("end", [terminate, kill])
def test_the_memory_goes_away_and_comes_back_under_load(memory: Servers, end: Callable[[Server], None]) -> None:
    """Streams continue; a callback is only accepted if it is on disk, and is then delivered once the server is back.

    Streams that end meanwhile are listed no more.
    """
    with (
        hub() as stage,
        receiving() as receiver,
        gateways(stage, memory.url) as (one, other),
    ):
        paths = [f"/{index}" for index in range(10)]
        made = [each.subscribed(receiver.url(path)) for path, each in zip(paths, 5 * [one, other], strict=True)]
        receiver.wait(10)
        with Socket(one.rotation) as watching, contextlib.ExitStack() as later:
            assert watching.next().angle == stage.angle

            readers = [watching]

            def drive(steps: int) -> None:
                """Each change is seen by the WebSockets, so that it was a separate one."""
                for _ in range(steps):
                    stage.step()
                    assert {reader.next().angle for reader in readers} == {stage.angle}

            drive(25)
            early = later.enter_context(Socket(one.rotation))
            early.next()
            for node in memory.nodes:
                end(node)
            early.close()
            with Socket(one.rotation) as late:
                late.next()
            drive(25)
            refused = one.subscribe(receiver.url("/refused"))
            assert refused.status_code == 503
            assert int(refused.headers["retry-after"]) > 0
            assert refused.headers["content-type"] == "application/problem+json"
            upgrade = {"connection": "Upgrade", "upgrade": "callback", "callback": receiver.url("/refused")}
            for each in (one, other):
                assert each.get(each.container).status_code == 503
                assert each.get(each.rotation).status_code == 200
                assert each.get(each.joint).status_code == 200
                assert each.browser.http.get(each.rotation, headers=upgrade).status_code == 503
                assert each.browser.http.delete(each.here(made[0])).status_code == 503
            opened = later.enter_context(Socket(other.rotation))
            assert opened.next().angle == stage.angle
            readers.append(opened)
            drive(25)
            memory.start()
            drive(25)
            for path in paths:
                arrived(receiver, path, stage.angle)
                deliveries(receiver.log(path, "POST"))
            streams = {one.get(each.here(stream.description)).url.path
                       for each, stream in ((one, watching), (other, opened))}  # fmt: skip
            expected = {one.get(one.here(iri)).url.path for iri in made} | streams
            for each in (one, other):
                eventually(lambda each=each: each.listed() == expected, "every subscription listed")
            drive(10)
            for path in paths:
                arrived(receiver, path, stage.angle)
                deliveries(receiver.log(path, "POST"))
        assert receiver.log("/refused") == []
        eventually(lambda: len(one.listed()) == len(paths), "closed streams listed no more")
        assert one.listed() == other.listed()
