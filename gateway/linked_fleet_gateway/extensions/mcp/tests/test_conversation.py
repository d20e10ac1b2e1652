"""The Model Context Protocol as a client uses it: finding, moving, refusals and stops."""

import json
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from mcp_client import DEGREE, McpClient, mcp_session, text_of
from parallel import pool
from running import eventually

pytestmark = pytest.mark.virtual
PAGE = "https://agent.example"
SESSIONS = 3
ELBOW = f"/{SEEN}/elbow_joint"
ROTATE = ELBOW + "/actions/rotate"


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    bounds = ("--mcp-sessions-per-client", str(SESSIONS), "--mcp-idle-s", "30", "--cors-origins", PAGE)
    with run_authenticated(tmp_path_factory.mktemp("mcp"), *bounds) as one:
        one.add("lab", "read", "act", robots=("lab-*",))
        one.add("reader", "read")
        one.add("stopper", "read", "stop")
        for name in ("lab", "reader", "stopper"):
            one.known(name)
        yield one


@pytest.fixture
def lab(here: AuthenticatedGateway) -> Iterator[McpClient]:
    with mcp_session(here.root, here.tokens["lab"]) as one:
        yield one
        one.end()


def _degrees(value: float, **more: object) -> dict[str, object]:
    return {"value": value, "unit": DEGREE, **more}


def _moved_to(speaker: McpClient, value: float) -> None:
    found = speaker.call("read", target=f"{ELBOW}/rotation")["structuredContent"]["value"]
    assert found == pytest.approx(value * 3.14159265 / 180, abs=0.02)


# -- what there is --------------------------------------------------------------------------------------------------


def test_a_session_begins_with_the_capabilities_of_the_server(here: AuthenticatedGateway) -> None:
    speaker = McpClient(here.root, here.tokens["lab"])
    opened = speaker.open()
    assert opened["serverInfo"]["name"] == "linked-fleet" and "rehearse" in opened["instructions"]
    assert set(opened["capabilities"]) >= {"tools", "resources"}
    assert speaker.end() == 200
    assert speaker.post({"jsonrpc": "2.0", "id": 1, "method": "ping"}).status_code == 404


def test_tools_are_few_and_describe_their_arguments(lab: McpClient) -> None:
    tools = {each["name"]: each for each in lab.ask("tools/list")["result"]["tools"]}
    assert [*tools] == ["find", "read", "query", "rehearse", "act", "write", "stop"]
    assert tools["act"]["inputSchema"]["required"] == ["action"]
    assert tools["act"]["inputSchema"]["properties"]["rehearse"]["default"] is True
    assert [name for name, each in tools.items() if not each["annotations"]["readOnlyHint"]] == [
        "act", "write", "stop"
    ]  # fmt: skip


def test_the_find_tool_returns_callable_actions_that_the_caller_may_see(
    lab: McpClient, here: AuthenticatedGateway
) -> None:
    robots = lab.call("find", kind="robot")["structuredContent"]["items"]
    assert [each["name"] for each in robots] == [SEEN]
    found = lab.call("find", text="elbow_joint absolute", kind="action")["structuredContent"]
    (action,) = found["items"]
    assert (action["iri"], found["more"]) == (here.root.rstrip("/") + ROTATE, False)
    assert set(action["body_schema"]["required"]) == {"value", "unit"}
    assert lab.call("act", action=action["iri"], body=_degrees(60))["isError"] is False
    _moved_to(lab, 60)
    assert lab.call("find", robot=HIDDEN)["structuredContent"]["items"] == []
    assert lab.call("find", limit=2)["structuredContent"]["more"] is True


def test_only_permitted_actions_are_found(here: AuthenticatedGateway) -> None:
    def kinds(name: str) -> set[str]:
        with mcp_session(here.root, here.tokens[name]) as one:
            items = one.call("find", kind="action", robot=SEEN, limit=50)["structuredContent"]["items"]
            one.end()
            return {each["call"]["tool"] for each in items}

    assert (kinds("reader"), kinds("stopper"), kinds("lab")) == (set(), {"stop"}, {"act", "stop"})


def test_resources_are_the_tree(lab: McpClient, here: AuthenticatedGateway) -> None:
    listed = lab.ask("resources/list")["result"]["resources"]
    assert [each["uri"] for each in listed] == [here.root, f"{here.root}{SEEN}/"]
    templates = lab.ask("resources/templates/list")["result"]["resourceTemplates"]
    assert [each["mimeType"] for each in templates] == ["application/ld+json", "text/turtle"]
    uri = here.root.rstrip("/") + ELBOW
    (as_json,) = lab.ask("resources/read", {"uri": uri})["result"]["contents"]
    assert as_json["mimeType"] == "application/ld+json" and json.loads(as_json["text"])
    (as_turtle,) = lab.ask("resources/read", {"uri": uri + "?as=turtle"})["result"]["contents"]
    assert as_turtle["mimeType"] == "text/turtle" and "elbow_joint" in as_turtle["text"]


@pytest.mark.parametrize("path", [f"{HIDDEN}/", "nothing/", "nothing", "?as=nothing"])
def test_an_unreadable_resource_is_a_protocol_error(lab: McpClient, here: AuthenticatedGateway, path: str) -> None:
    error = lab.ask("resources/read", {"uri": here.root + path})["error"]
    assert error["code"] == -32602 and error["data"]["status"] in (404, 406)


def test_queries_are_those_of_the_fleet_that_the_caller_sees(lab: McpClient) -> None:
    query = "SELECT ?robot { ?robot a <https://w3id.org/linked-fleet#Robot> }"
    rows = lab.call("query", query=query)["structuredContent"]["results"]["bindings"]
    assert len(rows) == 1 and rows[0]["robot"]["value"].endswith(f"/{SEEN}/")
    assert "SPARQL" in text_of(lab.call("query", query="SELECT nothing"))


def test_the_endpoint_describes_itself(here: AuthenticatedGateway) -> None:
    with here.browsing("lab") as browser:
        answer = browser.http.get(here.root + "mcp", headers={"accept": "text/turtle"})
        assert answer.status_code == 200 and "Model Context Protocol" in answer.text
        assert browser.http.get(here.root + "mcp/", headers={"accept": "text/turtle"}).status_code in (200, 308)
        streams = browser.http.get(here.root + "mcp", headers={"accept": "text/event-stream"})
        assert (streams.status_code, streams.headers["allow"]) == (405, "POST, DELETE")


# -- what moves -----------------------------------------------------------------------------------------------------


def test_a_motion_is_followed_to_its_end(lab: McpClient) -> None:
    lab.call("act", action=ROTATE, body=_degrees(0))
    result = lab.call("act", action=ROTATE, body=_degrees(90, speedScale=0.2))
    assert result["isError"] is False and "succeeded" in text_of(result)
    assert result["structuredContent"]["state"].endswith("#succeeded")
    progress = [each["params"]["progress"] for each in lab.heard]
    assert len(progress) > 2 and progress == sorted(set(progress)) and progress[-1] == 1.0
    _moved_to(lab, 90)


def test_a_call_without_waiting_returns_the_invocation(lab: McpClient) -> None:
    result = lab.call("act", action=ROTATE, body=_degrees(0, speedScale=0.1), wait_s=0)
    assert result["isError"] is False and "has not ended" in text_of(result)
    iri = result["structuredContent"]["iri"]
    assert lab.call("stop", target=iri)["isError"] is False
    eventually(
        lambda: lab.call("read", target=iri)["structuredContent"]["state"].endswith("#cancelled"), "the end of it"
    )


def test_a_rehearsal_moves_nothing(lab: McpClient) -> None:
    before = lab.call("read", target=f"{ELBOW}/rotation")["structuredContent"]["value"]
    result = lab.call("rehearse", action=ROTATE, body=_degrees(45))
    assert result["isError"] is False and "Nothing has moved" in text_of(result)
    assert result["structuredContent"]["duration"]["value"] > 0
    assert lab.call("read", target=f"{ELBOW}/rotation")["structuredContent"]["value"] == before


@pytest.mark.parametrize("rehearse", [True, False])
def test_a_refusal_has_the_reason_of_the_shape(lab: McpClient, rehearse: bool) -> None:
    invocations = lab.call("read", target=f"{ROTATE}/invocations", format="turtle")
    result = lab.call("act", action=ROTATE, body=_degrees(200), rehearse=rehearse)
    assert result["isError"] is True and "200 must be at most 180" in text_of(result)
    problem = result["structuredContent"]
    assert problem["status"] == 422 and "at most" in problem["report"][0]["message"]
    assert ROTATE in problem["constraint"]
    assert lab.call("read", target=f"{ROTATE}/invocations", format="turtle") == invocations


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"action": ROTATE, "body": {"value": 1}}, "unit"),
        ({"action": ROTATE, "body": {"value": 1, "unit": DEGREE, "x": 1}}, "x is not known"),
        ({"action": ROTATE, "body": [1]}, "body: Input should be a valid dictionary"),
        ({"action": ROTATE, "x": 1}, "x: Extra inputs are not permitted"),
        ({}, "action: Field required"),
        ({"action": ELBOW, "body": _degrees(1)}, "405"),
        ({"action": f"/{HIDDEN}/elbow_joint/actions/rotate", "body": _degrees(1)}, "404"),
        ({"action": "https://evil.example/", "body": _degrees(1)}, "is no path"),
        ({"action": ROTATE, "body": _degrees(1), "lock_token": "x"}, "Lock-Token"),
        ({"action": ROTATE, "body": _degrees(1), "wait_s": 1e9}, "wait_s"),
    ],
)
def test_an_invalid_call_is_answered_with_a_correction(
    lab: McpClient, arguments: dict[str, object], reason: str
) -> None:
    result = lab.call("act", **arguments)
    assert result["isError"] is True and reason in text_of(result)


def test_rights_leases_and_the_audit_are_those_of_the_caller(here: AuthenticatedGateway, lab: McpClient) -> None:
    with mcp_session(here.root, here.tokens["reader"]) as reader:
        refusal = reader.call("act", action=ROTATE, body=_degrees(1))
        assert refusal["isError"] is True and refusal["structuredContent"]["status"] == 403
        assert reader.call("stop", target=f"/{SEEN}/")["structuredContent"]["status"] == 403
        reader.end()
    lease = {"content-type": "text/turtle"}
    body = '<> <https://w3id.org/linked-fleet#holder> "other" ; <https://w3id.org/linked-fleet#leaseDuration> 60 .'
    with here.browsing("root") as root:
        taken = root.http.put(f"{here.root}{SEEN}/lease", content=body, headers=lease)
        assert taken.status_code == 204, taken.text
        token = taken.headers["lock-token"]
        refusal = lab.call("act", action=ROTATE, body=_degrees(10))
        assert refusal["isError"] is True and refusal["structuredContent"]["status"] == 409
        assert lab.call("act", action=ROTATE, body=_degrees(10), lock_token=token)["isError"] is False
        assert lab.call("stop", target=ELBOW)["isError"] is False
        root.http.delete(f"{here.root}{SEEN}/lease", headers={"lock-token": token})
        audit = root.http.get(f"{here.root}audit", headers={"accept": "text/turtle"}).text
    assert f"POST {ROTATE}" in audit and '"lab"' in audit and "POST /mcp" not in audit


def test_a_key_moves_once(lab: McpClient) -> None:
    ends = [lab.call("act", action=ROTATE, body=_degrees(5), idempotency_key="once") for _ in range(2)]
    assert len({each["structuredContent"]["iri"] for each in ends}) == 1


# -- what stops -----------------------------------------------------------------------------------------------------


def test_cancelling_the_request_cancels_the_motion(lab: McpClient) -> None:
    lab.call("act", action=ROTATE, body=_degrees(0))
    with pool(1) as beside:
        slow = _degrees(120, speedScale=0.02)
        params = {"name": "act", "arguments": {"action": ROTATE, "body": slow, "wait_s": 600}}
        running = beside.submit(lab.ask, "tools/call", params, 77)
        newest = eventually(lambda: _running(lab), "the motion")
        cancelled = {"jsonrpc": "2.0", "method": "notifications/cancelled", "params": {"requestId": 77}}
        assert lab.post(cancelled).status_code == 202
        assert running.result()["error"]["code"] == -32800
    found = lab.call("read", target=newest)["structuredContent"]
    assert found["state"].endswith("#cancelled") and found["progress"]["value"] < 0.5


def _running(speaker: McpClient) -> str | None:
    """Return the IRI of the running invocation of the action."""
    said = json.loads(text_of(speaker.call("read", target=f"{ROTATE}/invocations", format="jsonld")))
    nodes = said.get("@graph", [said])
    return next((str(each["@id"]) for each in nodes if each.get("lf:state") == {"@id": "lf:running"}), None)


@pytest.mark.parametrize("target", ["/", f"/{SEEN}/", ELBOW, f"{ELBOW}/rotation", f"/{SEEN}/actions/stop", None])
def test_the_stop_tool_stops_joints_robots_and_invocations(lab: McpClient, target: str | None) -> None:
    lab.call("act", action=ROTATE, body=_degrees(0))
    moving = lab.call("act", action=ROTATE, body=_degrees(120, speedScale=0.02), wait_s=0)["structuredContent"]["iri"]
    result = lab.call("stop", **({} if target is None else {"target": target}))
    assert result["isError"] is False and "Done" in text_of(result)
    eventually(
        lambda: lab.call("read", target=moving)["structuredContent"]["state"].endswith("#cancelled"), "the end of it"
    )


@pytest.mark.parametrize("target", ["/", "", f"/{SEEN}/", ELBOW, f"/{SEEN}/actions/stop"])
def test_tools_take_iris_below_every_public_url_of_the_fleet(lab: McpClient, target: str) -> None:
    """A person may give an IRI that is not below the URL by which the model reaches the gateway."""
    other = str(httpx.URL(lab.url).copy_with(host="localhost")).removesuffix("/mcp")
    action = other + ROTATE
    assert lab.call("act", action=action, body=_degrees(0))["isError"] is False
    assert lab.call("rehearse", action=action, body=_degrees(120))["isError"] is False
    moving = lab.call("act", action=action, body=_degrees(120, speedScale=0.02), wait_s=0)["structuredContent"]["iri"]
    result = lab.call("stop", target=other + target)
    assert result["isError"] is False and "Done" in text_of(result)
    moving = str(httpx.URL(moving).copy_with(host="localhost"))
    eventually(
        lambda: lab.call("read", target=moving)["structuredContent"]["state"].endswith("#cancelled"), "the end of it"
    )


NO_IDS = ["1.0", "1e0", "1.5", "null", "true", "false", "{}", "[]", "[1]", None]


@pytest.mark.parametrize("method", ["tools/call", "resources/read", "ping", "tools/list", "nothing"])
@pytest.mark.parametrize("id", NO_IDS)
def test_a_request_without_a_usable_id_is_refused(lab: McpClient, id: str | None, method: str) -> None:
    """Also a stop: the SDK would take it for a notification and do nothing."""
    lab.call("act", action=ROTATE, body=_degrees(0))
    moving = lab.call("act", action=ROTATE, body=_degrees(120, speedScale=0.02), wait_s=0)["structuredContent"]["iri"]
    member = "" if id is None else f'"id": {id}, '
    params = json.dumps({"name": "stop", "arguments": {}, "uri": lab.url.removesuffix("mcp")})
    answer = lab.post(f'{{"jsonrpc": "2.0", {member}"method": "{method}", "params": {params}}}'.encode())
    assert (answer.status_code, answer.json()["error"]["code"], answer.json()["id"]) == (400, -32600, None)
    assert "must be a string or an integer" in answer.json()["error"]["message"]
    assert lab.call("read", target=moving)["structuredContent"]["state"].endswith("#running")
    assert lab.call("stop", target=moving)["isError"] is False


@pytest.mark.parametrize("id", [0, -1, 2**70, "", "a", "1.0", "null"])
def test_each_string_and_integer_is_an_id(lab: McpClient, id: object) -> None:
    params = {"name": "stop", "arguments": {}}
    answer = lab.post({"jsonrpc": "2.0", "id": id, "method": "tools/call", "params": params})
    said = json.loads(answer.text.rpartition("data: ")[2])
    assert (answer.status_code, said["id"], said["result"]["isError"]) == (200, id, False)


@pytest.mark.parametrize(
    "message",
    [
        {"id": 1},
        {},
        {"result": {}},
        {"id": 1.5, "result": {}},
        {"id": 1, "method": "notifications/cancelled", "params": {"requestId": 1}},
        {"id": None, "method": "notifications/cancelled", "params": {"requestId": 1}},
        {"id": 1, "method": 1},
        {"method": None},
    ],
)
def test_a_message_of_no_kind_is_refused(lab: McpClient, message: dict[str, object]) -> None:
    answer = lab.post({"jsonrpc": "2.0", **message})
    assert (answer.status_code, answer.json()["error"]["code"]) == (400, -32600)


@pytest.mark.parametrize(("first", "second"), [(77, 77), ("77", "77"), (77, "77")])
def test_an_id_in_use_is_refused_and_the_first_call_goes_on(lab: McpClient, first: object, second: object) -> None:
    lab.call("act", action=ROTATE, body=_degrees(0))

    def post(id: object, value: float, speed: float) -> httpx.Response:
        arguments = {"action": ROTATE, "body": _degrees(value, speedScale=speed), "wait_s": 600}
        params = {"name": "act", "arguments": arguments}
        return lab.post({"jsonrpc": "2.0", "id": id, "method": "tools/call", "params": params})

    with pool(1) as beside:
        running = beside.submit(post, first, 60, 0.05)
        eventually(lambda: _running(lab), "the motion")
        answer = post(second, -60, 1.0)
        assert (answer.status_code, answer.json()["error"]["code"]) == (400, -32600)
        assert "take another one" in answer.json()["error"]["message"]
        said = json.loads(running.result().text.rpartition("data: ")[2])
    assert (said["id"], said["result"]["isError"]) == (first, False)
    _moved_to(lab, 60)
    assert "succeeded" in post(first, 0, 1.0).text  # free again


def test_sessions_and_clients_have_ids_of_their_own(here: AuthenticatedGateway, lab: McpClient) -> None:
    lab.call("act", action=ROTATE, body=_degrees(0))
    with pool(1) as beside, mcp_session(here.root, here.tokens["lab"]) as other:
        slow = {"action": ROTATE, "body": _degrees(120, speedScale=0.02), "wait_s": 600}
        running = beside.submit(lab.ask, "tools/call", {"name": "act", "arguments": slow}, 77)
        eventually(lambda: _running(lab), "the motion")
        assert other.call("stop", id=77, target=f"/{SEEN}/")["isError"] is False
        assert "cancelled" in text_of(running.result()["result"])
        other.end()


@pytest.mark.parametrize("target", ["https://elsewhere.example/", f"http://elsewhere.example/{SEEN}/"])
def test_a_stop_of_something_elsewhere_says_what_would_have_been_right(lab: McpClient, target: str) -> None:
    result = lab.call("stop", target=target)
    assert result["isError"] and result["structuredContent"]["status"] == 400
    assert lab.url.removesuffix("mcp") in text_of(result)


def test_reads_hold_up_no_stop(tmp_path: Path) -> None:
    """A client that asked too often is refused everything but stops."""
    read = {"name": "read", "arguments": {"target": "/"}}
    message = {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": read}
    with (
        run_authenticated(tmp_path, "--requests-per-client", "1") as one,
        mcp_session(one.root, one.tokens["root"]) as speaker,
    ):
        answers = [speaker.post(message).status_code for _ in range(20)]
        assert answers[0] == 200 and answers[-1] == 429
        for _ in range(20):
            assert speaker.call("stop", target=f"/{SEEN}/")["isError"] is False
        assert speaker.post(message).status_code == 429


# -- sessions and bounds ----------------------------------------------------------------------------------------------


def test_a_session_belongs_to_its_caller(here: AuthenticatedGateway, lab: McpClient) -> None:
    other = {"authorization": f"Bearer {here.tokens['reader']}"}
    ping = {"jsonrpc": "2.0", "id": 1, "method": "ping"}
    assert [lab.post(ping, **other).status_code, lab.post(ping).status_code] == [404, 200]
    assert lab.post(ping, authorization="Bearer x").status_code == 401


def test_sessions_are_bounded_in_number_and_time(here: AuthenticatedGateway) -> None:
    websocket_handlers = [McpClient(here.root, here.tokens["stopper"]) for _ in range(SESSIONS)]
    for each in websocket_handlers:
        each.open()
    one_more = McpClient(here.root, here.tokens["stopper"])
    initialize = {"protocolVersion": "2025-11-25", "capabilities": {}, "clientInfo": {"name": "x", "version": "1"}}
    message = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": initialize}
    assert one_more.post(message).status_code == 503
    with mcp_session(here.root, here.tokens["reader"]) as other:
        other.end()
    time.sleep(29)
    ping = {"jsonrpc": "2.0", "id": 1, "method": "ping"}
    assert websocket_handlers[0].post(ping).status_code == 200
    time.sleep(15)
    assert [each.post(ping).status_code for each in websocket_handlers] == [200, 404, 404]
    one_more.open()
    assert [one_more.end(), websocket_handlers[0].end()] == [200, 200]


@pytest.mark.parametrize(
    ("content", "status", "code"),
    [
        (b"", 400, -32700),
        (b"{", 400, -32700),
        (b"\xff", 400, -32700),
        (b'{"a": 1, "a": 2}', 400, -32700),
        (b'{"a": NaN}', 400, -32700),
        (b"[" * 100, 400, -32700),
        (b"[" + b"1," * 30_000 + b"1]", 400, -32700),
        (b"[]", 400, -32600),
        (b"1", 400, -32600),
        (b'{"jsonrpc": "1.0", "id": 1, "method": "ping"}', 400, -32600),
        (b'{"jsonrpc": "2.0", "id": 1, "method": "nothing"}', 200, -32601),
        (b'{"jsonrpc": "2.0", "id": 1, "method": "tools/call"}', 200, -32602),
        (b'{"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": {"name": "nothing"}}', 200, -32602),
        (b'{"jsonrpc": "2.0", "id": 1, "method": "resources/read", "params": {"uri": 1}}', 200, -32602),
    ],
)
def test_bad_messages_get_the_errors_of_json_rpc(lab: McpClient, content: bytes, status: int, code: int) -> None:
    answer = lab.post(content)
    text = answer.text.rpartition("data: ")[2]
    assert (answer.status_code, json.loads(text)["error"]["code"]) == (status, code)


def test_an_invalid_message_is_refused_as_by_other_resources(lab: McpClient) -> None:
    assert lab.post(b'"' + b"x" * 300_000 + b'"').status_code == 413
    assert lab.post({}, **{"content-type": "text/turtle"}).status_code == 415
    assert lab.post({}, **{"content-encoding": "gzip"}).status_code == 415
    assert lab.post({"jsonrpc": "2.0", "id": 1, "method": "ping"}, accept="text/turtle").status_code == 406
    assert lab.http.put(lab.url, headers=lab.fields, content=b"{}").status_code == 405


def test_pages_of_other_sites_need_the_leave_of_the_operator(lab: McpClient) -> None:
    ping = {"jsonrpc": "2.0", "id": 1, "method": "ping"}
    assert lab.post(ping, origin="https://evil.example").status_code == 403
    answer = lab.post(ping, origin=PAGE)
    assert answer.status_code == 200 and "mcp-session-id" in answer.headers["access-control-expose-headers"]
    names = "authorization, content-type, mcp-session-id, mcp-protocol-version"
    asked = {"origin": PAGE, "access-control-request-method": "POST", "access-control-request-headers": names}
    assert httpx.options(lab.url, headers=asked).status_code == 200


def test_a_gateway_without_the_extension_has_no_such_resource(tmp_path: Path) -> None:
    with run_authenticated(tmp_path, "--extensions-off", "mcp", robots=False) as one, one.browsing("root") as browser:
        one.add("all", *ALL)
        assert browser.http.get(one.root + "mcp").status_code == 404
