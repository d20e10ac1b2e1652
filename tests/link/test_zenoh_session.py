"""Features of a gateway's session that only Zenoh has: opening, and heartbeats while the event loop hangs."""

import asyncio
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from link.parts import Zenoh
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.transport import HEARTBEAT_S
from linked_fleet_link.fleet_link import FleetLink
from linked_fleet_link.transport import LinkError
from linked_fleet_link.zenoh_session import ZenohSession, open_session
from running import free_port
from serving import until

pytestmark = pytest.mark.processes
KEYS = Keys()


@asynccontextmanager
async def opened(endpoint: str) -> AsyncIterator[ZenohSession]:
    session = await open_session((endpoint,), (), {})
    try:
        yield session
    finally:
        await session.close()


async def test_a_taken_port_is_one_clear_line() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    async with opened(endpoint):
        with pytest.raises(LinkError, match="is taken by another process") as caught:
            await open_session((endpoint,), (), {})
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("endpoint", "trust", "said"),
    [
        ("tcp/127.0.0.1:port", {}, "Zenoh does not open"),
        ("nonsense", {}, "Zenoh does not take listen/endpoints"),
        ("tcp/127.0.0.1:0", {"transport/link/tls": 1}, "Zenoh does not take transport/link/tls"),
    ],
)
def test_a_configuration_that_means_nothing_is_one_clear_line(
    endpoint: str, trust: dict[str, object], said: str
) -> None:
    with pytest.raises(LinkError, match=said) as caught:
        asyncio.run(open_session((endpoint,), (), trust))
    assert "\n" not in str(caught.value)


async def test_a_client_session_is_connected_with_a_peer() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    session = await open_session((), (endpoint,), {})
    assert not session.connected
    async with opened(endpoint) as other:
        await until(lambda: session.connected)
        assert other.connected
    await until(lambda: not session.connected)
    await session.close()
    await session.close()


async def test_frames_are_read_by_one_thread_however_often_the_gateway_declares_itself_anew() -> None:
    async with opened(f"tcp/127.0.0.1:{free_port()}") as session:
        others = {*threading.enumerate()}
        await session.subscribe_frames(KEYS.all_states, 10, lambda *_: None)
        for _ in range(5):
            await session.redeclare()
        await until(
            lambda: [one.name for one in {*threading.enumerate()} - others if one.name == "frames"] == ["frames"]
        )


def test_heartbeats_come_while_the_event_loop_runs_and_at_no_other_time() -> None:
    async def beats(part: Zenoh) -> None:
        async with FleetLink(KEYS, "g", part.gateway, lambda _: None, lambda *_: None) as link:
            await link.join()
            agent, heard = await part.agent("r"), list[str]()
            with agent.subscribe(KEYS.all_heartbeats, heard.append):
                await until(lambda: len(heard) > 2)
                before = len(heard)
                time.sleep(5 * HEARTBEAT_S)  # noqa: ASYNC251 - the event loop hangs
                await asyncio.sleep(0)
                assert len(heard) <= before + 1  # one in transit
                await until(lambda: len(heard) > before + 2)

    Zenoh.run(beats)  # type: ignore[arg-type]
