"""The client of the SDK as a black box: it discovers a robot, moves it, is refused at 100 degrees, and cancels."""

import asyncio
from collections.abc import Iterator

import pytest
from mcp.client.client import Client
from mcp_types import CallToolResult, TextContent

from running import eventually, process
from small_fleet import Place, live
from speaking import DEGREE

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
JOINT = "/panda/panda_joint4"
ROTATE = JOINT + "/actions/rotate"
ERAS = ("legacy", "2026-07-28")
"""Revisions with a handshake and a session, and the one without."""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    place = Place(tmp_path_factory.mktemp("mcp"))
    agent = ("-m", "linked_fleet_agent", "--robot=panda", "--connect", place.zenoh)
    with place.gateway() as (_, browser), process(*agent):
        live(browser, "panda")
        body = {"value": -100, "unit": DEGREE}
        eventually(lambda: not _called(place.root, "rehearse", action=ROTATE, body=body).is_error, "a world to move in")
        yield place.root


def _called(root: str, tool: str, era: str = ERAS[0], **arguments: object) -> CallToolResult:
    async def call() -> CallToolResult:
        async with Client(root + "mcp", mode=era) as client:
            return await client.call_tool(tool, arguments)

    return asyncio.run(call())


def _text(result: CallToolResult) -> str:
    return "\n".join(each.text for each in result.content if isinstance(each, TextContent))


@pytest.mark.parametrize("era", ERAS)
def test_it_discovers_and_moves_a_robot(root: str, era: str) -> None:
    told: list[float] = []

    async def progress(done: float, whole: float | None, state: str | None) -> None:
        told.append(done)

    async def run() -> CallToolResult:
        async with Client(root + "mcp", mode=era) as client:
            tools = [each.name for each in (await client.list_tools()).tools]
            assert tools == ["find", "read", "query", "rehearse", "act", "stop"]
            assert f"{root}panda/" in [each.uri for each in (await client.list_resources()).resources]
            found = await client.call_tool("find", {"text": "joint4 absolute", "kind": "action"})
            (action,) = found.structured_content["items"]
            body = {"value": -60 if era == ERAS[0] else -80, "unit": DEGREE}
            return await client.call_tool("act", {"action": action["iri"], "body": body}, progress_callback=progress)

    result = asyncio.run(run())
    assert not result.is_error, _text(result)
    assert result.structured_content["state"].endswith("#succeeded")
    assert told[-1] == 1.0 and told == sorted(told)


@pytest.mark.parametrize("era", ERAS)
def test_it_is_refused_with_the_reason(root: str, era: str) -> None:
    result = _called(root, "act", era, action=ROTATE, body={"value": 100, "unit": DEGREE})
    assert result.is_error and "100 must be at most -3.999" in _text(result)


@pytest.mark.parametrize("era", ERAS)
def test_it_cancels(root: str, era: str) -> None:
    body = {"value": -150 if era == ERAS[0] else -30, "unit": DEGREE, "speedScale": 0.02}

    async def run() -> None:
        async with Client(root + "mcp", mode=era) as client:
            begun = asyncio.Event()

            async def progress(done: float, whole: float | None, state: str | None) -> None:
                begun.set()

            acting = asyncio.create_task(
                client.call_tool("act", {"action": ROTATE, "body": body}, progress_callback=progress)
            )
            await begun.wait()
            acting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await acting

    before = _cancelled(root)
    asyncio.run(run())
    eventually(lambda: _cancelled(root) == before + 1, "the end of the motion")


def _cancelled(root: str) -> int:
    """Return the number of cancelled invocations of the action."""
    return _text(_called(root, "read", target=f"{ROTATE}/invocations", format="turtle")).count("lf:cancelled")
