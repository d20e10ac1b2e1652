"""Clients of others as black boxes: that of the SDK, the command line of the official inspector, the conformance suite.

They discover a robot, move it, are refused at 100 degrees, and cancel.
"""

import asyncio
import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from mcp.client.client import Client
from mcp_types import CallToolResult, TextContent

from browser import Browser
from mcp_client import DEGREE
from running import PATIENCE_S, eventually, process
from small_fleet import Place, live
from wot import HERE, node

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
JOINT = "/panda/panda_joint4"
ROTATE = JOINT + "/actions/rotate"
ERAS = ("legacy", "2026-07-28")
"""Revisions with a handshake and a session, and the one without."""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    place = Place(tmp_path_factory.mktemp("mcp"))
    agent = ("-m", "linked_fleet_agent", "--robot=panda", "--connect", place.zenoh)
    sessions = ("--mcp-sessions-per-client", "100")  # the suite ends none of its own
    with process(*place.command(), *sessions) as gateway, closing(Browser(place.root)) as browser, process(*agent):
        gateway.said("serving")
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


def test_the_sdk_finds_reads_and_uses_a_component(root: str) -> None:
    async def run() -> tuple[str, str, str]:
        async with Client(root + "mcp", mode=ERAS[1]) as client:
            found = await client.call_tool("find", {"text": "gripper grasp", "kind": "action"})
            done = await client.call_tool("act", {"action": "/panda/gripper/actions/open", "body": {}})
            return _text(found), _text(done), _text(await client.call_tool("read", {"target": "/panda/gripper"}))

    found, done, said = asyncio.run(run())
    assert "/panda/gripper/actions/grasp" in found
    assert "succeeded" in done, done
    assert "width" in said, said


@pytest.mark.parametrize("era", ERAS)
def test_the_sdk_finds_and_moves_a_robot(root: str, era: str) -> None:
    told: list[float] = []

    async def progress(done: float, whole: float | None, state: str | None) -> None:
        told.append(done)

    async def run() -> CallToolResult:
        async with Client(root + "mcp", mode=era) as client:
            tools = [each.name for each in (await client.list_tools()).tools]
            assert tools == ["find", "read", "query", "rehearse", "act", "write", "stop"]
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
def test_the_sdk_plans_and_runs_a_mission(root: str, era: str) -> None:
    body = {"value": {"variable": "angle"}, "unit": DEGREE}
    turn = {"type": "invoke", "action": root[:-1] + ROTATE, "body": body}
    angle = {"name": "angle", "type": "number", "minimum": -120, "maximum": -60}
    mission = {"title": f"Turn {era}", "parameters": [angle], "step": {"type": "sequence", "steps": [turn, turn]}}

    async def run() -> CallToolResult:
        async with Client(root + "mcp", mode=era) as client:
            found = await client.call_tool("find", {"text": "missions", "kind": "container"})
            container = found.structured_content["items"][0]
            planned = {"target": container["iri"], "body": mission}
            assert "Nothing has changed" in _text(await client.call_tool("write", planned))
            await client.call_tool("write", planned | {"keep": True})
            found = await client.call_tool("find", {"text": f"turn {era}", "kind": "action"})
            (action,) = found.structured_content["items"]
            assert action["body_schema"]["required"] == ["angle"]
            return await client.call_tool("act", {"action": action["iri"], "body": {"angle": -90}})

    result = asyncio.run(run())
    assert not result.is_error, _text(result)
    run_path = f"/mission-runs/{result.structured_content['id']}"
    steps = _called(root, "read", era, target=run_path).structured_content["steps"]
    assert [each["state"] for each in steps] == ["succeeded", "succeeded"]


@pytest.mark.parametrize("era", ERAS)
def test_the_sdk_gets_the_reason_of_a_refusal(root: str, era: str) -> None:
    result = _called(root, "act", era, action=ROTATE, body={"value": 100, "unit": DEGREE})
    assert result.is_error and "100 must be at most -3.999" in _text(result)


@pytest.mark.parametrize("era", ERAS)
def test_the_sdk_cancels_a_motion(root: str, era: str) -> None:
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


# -- the command line of the inspector ------------------------------------------------------------------------------


class Inspector:
    """``mcp-inspector --cli`` with a home of its own."""

    def __init__(self, root: str, home: Path) -> None:
        program = HERE / "node_modules/@modelcontextprotocol/inspector/clients/launcher/build/index.js"
        self._command = [node(), str(program), "--cli", root + "mcp", "--transport", "http"]
        self._environment = os.environ | {"HOME": str(home)}

    def start(self, method: str, *more: str) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [*self._command, "--method", method, *more],
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, method: str, *more: str) -> dict[str, Any]:
        with self.start(method, *more) as child:
            said, errors = child.communicate(timeout=PATIENCE_S)
        found: dict[str, Any] = json.loads(said or errors)
        return found

    def call(self, tool: str, **arguments: object) -> dict[str, Any]:
        return self.run(*self.words(tool, **arguments))

    @staticmethod
    def words(tool: str, **arguments: object) -> list[str]:
        return ["tools/call", "--tool-name", tool, "--tool-args-json", json.dumps(arguments)]


@pytest.fixture
def inspector(root: str, tmp_path: Path) -> Inspector:
    return Inspector(root, tmp_path)


def _told(result: dict[str, Any]) -> str:
    return "\n".join(each["text"] for each in result["content"])


def test_the_inspector_discovers_and_moves_a_robot(inspector: Inspector, root: str) -> None:
    tools = [each["name"] for each in inspector.run("tools/list")["tools"]]
    assert tools == ["find", "read", "query", "rehearse", "act", "write", "stop"]
    (action,) = inspector.call("find", text="joint4 absolute", kind="action")["structuredContent"]["items"]
    result = inspector.call("act", action=action["iri"], body={"value": -70, "unit": DEGREE})
    assert not result.get("isError") and "succeeded" in _told(result)
    value = _called(root, "read", target=f"{JOINT}/rotation").structured_content["value"]
    assert value == pytest.approx(-70 * 3.14159265 / 180, abs=0.02)


def test_the_inspector_is_refused_with_the_reason(inspector: Inspector) -> None:
    result = inspector.call("act", action=ROTATE, body={"value": 100, "unit": DEGREE})
    assert result["isError"] is True and "100 must be at most -3.999" in _told(result)
    assert result["structuredContent"]["status"] == 422


def test_a_motion_outlives_an_inspector_that_is_killed_and_is_stopped_by_another(
    inspector: Inspector, root: str
) -> None:
    """With sessions a lost connection is no cancellation (revision 2025-11-25, basic/transports)."""
    iri = _killed_while_it_moves(inspector, root, -100)
    assert _state(root, iri) == "running"
    result = inspector.call("stop", target=iri)
    assert not result.get("isError") and "Done" in _told(result)
    eventually(lambda: _state(root, iri) == "cancelled", "the end of the motion")


def test_without_sessions_killing_the_inspector_cancels_the_motion(inspector: Inspector, root: str) -> None:
    """A request ends with its stream (revision 2026-07-28)."""
    iri = _killed_while_it_moves(inspector, root, -30, "--protocol-era", "modern")
    eventually(lambda: _state(root, iri) == "cancelled", "the end of the motion")


def _killed_while_it_moves(inspector: Inspector, root: str, degrees: float, *more: str) -> str:
    """Begin a slow motion by an inspector, and kill the inspector during it. Return the IRI of the invocation."""
    body = {"value": degrees, "unit": DEGREE, "speedScale": 0.02}
    child = inspector.start(*inspector.words("act", action=ROTATE, body=body), *more)
    with child:
        iri = eventually(lambda: _running(root), "a motion")
        child.kill()
    return iri


def _running(root: str) -> str | None:
    said = json.loads(_text(_called(root, "read", target=f"{ROTATE}/invocations", format="jsonld")))
    nodes = said.get("@graph", [said])
    return next((str(each["@id"]) for each in nodes if each.get("lf:state") == {"@id": "lf:running"}), None)


def _state(root: str, iri: str) -> str:
    found = _called(root, "read", target=iri).structured_content
    return str(found["state"]).rpartition("#")[2]


# -- the conformance suite --------------------------------------------------------------------------------------------


def test_the_scenarios_of_the_conformance_suite_that_apply_hold(root: str, tmp_path: Path) -> None:
    """``conformance.yml`` lists the scenarios that do not apply. The suite fails if one of these passes."""
    program = HERE / "node_modules/@modelcontextprotocol/conformance/dist/index.js"
    baseline = Path(__file__).with_name("conformance.yml")
    command = [node(), program, "server", "--url", root + "mcp", "--suite", "all", "--expected-failures", baseline]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S * 4, check=False)
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
    passed = {line.split()[1].rstrip(":") for line in done.stdout.splitlines() if line.startswith("✓")}
    assert passed >= {
        "server-initialize", "ping", "tools-list", "resources-list", "server-sse-multiple-streams",
        "dns-rebinding-protection",
    }  # fmt: skip
