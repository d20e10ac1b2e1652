"""WebSockets in a protocol of an extension: this test's extension echoes messages."""

from collections.abc import Iterator

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from authenticated_gateway import ALL, AuthenticatedGateway, run_authenticated
from connections import WebSocket, websocket
from foreign_extension import installed

pytestmark = pytest.mark.virtual
LONGEST, PIECES = 1000, 64
_ECHO = f"""
    from contextlib import asynccontextmanager
    from websockets.frames import Opcode
    from linked_fleet_gateway.http.websocket import WebSocketHandler
    from linked_fleet_gateway.http.extension import Extension, Mount
    from linked_fleet_gateway.http.websocket import frame
    from linked_fleet_gateway.resources.branches import FleetBranch
    from linked_fleet_gateway.resources.resource import Resource

    class Pipe:
        pass

    async def speak(conversation, pipe):
        while True:
            message = await conversation.receive()
            if message == "flood":
                sent = [conversation.try_send(frame(Opcode.BINARY, bytes(20_000))) for _ in range({PIECES})]
                await conversation.send(str(sum(sent)))
            else:
                await conversation.send(message)

    class Added(Extension):
        name, at_root = "echo", ("echo",)

        @asynccontextmanager
        async def start(self, core):
            branch = FleetBranch("echo", None, lambda view, rest: Resource("/echo", "E", None, remote=Pipe()))
            handler = WebSocketHandler(("e.v1", "e.v2"), speak, {LONGEST})
            yield Mount(branches=(branch,), websocket_handlers={{Pipe: handler}})
"""


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    folder = tmp_path_factory.mktemp("echo")
    with installed(folder, "echo", _ECHO), run_authenticated(folder, "--extensions", "echo", robots=False) as one:
        one.add("reader", "read")
        one.known("reader")
        yield one


def opened(here: AuthenticatedGateway, name: str = "root", subprotocol: str | None = "e.v2") -> WebSocket:
    return websocket(f"{here.root}echo", {"authorization": f"Bearer {here.tokens[name]}"}, subprotocol)


def test_messages_of_the_client_are_received_in_the_subprotocol_that_it_names(here: AuthenticatedGateway) -> None:
    with opened(here) as client:
        assert client.subprotocol == "e.v2"
        for message in ("ü", b"\xff\x00", "x" * LONGEST, ""):
            client.send(message)
        assert [client.recv() for _ in range(4)] == ["ü", b"\xff\x00", "x" * LONGEST, ""]


@pytest.mark.parametrize(
    ("name", "subprotocol", "status"), [("root", None, 406), ("root", "lf.turtle", 406), ("reader", "e.v1", 403)]
)
def test_a_handshake_is_refused_in_http(
    here: AuthenticatedGateway, name: str, subprotocol: str | None, status: int
) -> None:
    with pytest.raises(InvalidStatus) as refused:
        opened(here, name, subprotocol)
    assert refused.value.response.status_code == status


def test_a_message_that_is_too_long_ends_the_connection(here: AuthenticatedGateway) -> None:
    with opened(here) as client:
        client.send("x" * (LONGEST + 1))
        with pytest.raises(ConnectionClosed) as end:
            client.recv()
    assert end.value.rcvd is not None and end.value.rcvd.code == 1009


def test_a_slow_reader_loses_what_is_offered_and_nothing_that_is_sent(here: AuthenticatedGateway) -> None:
    with opened(here) as client:
        client.send("flood")
        arrived = []
        while not isinstance(message := client.recv(), str):
            arrived.append(len(message))
    assert arrived == [20_000] * int(message)
    assert 3 < len(arrived) < PIECES


def test_the_connection_ends_when_the_rights_of_its_client_change(here: AuthenticatedGateway) -> None:
    """Including changes that do not concern reading."""
    here.add("changing", *ALL)
    here.known("changing")
    with opened(here, "changing") as client:
        client.send("x")
        assert client.recv() == "x"
        here.tables["changing"] = here.tables["changing"].replace('"act", ', "").replace(', "act"', "")
        here.write()
        with pytest.raises(ConnectionClosed) as end:
            client.recv()
    assert end.value.rcvd is not None and end.value.rcvd.code == 1008
