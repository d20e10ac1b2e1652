"""Foxglove live, in process: channels, messages, parameters and services, with and without the rights to them."""

import asyncio
import json
import struct
import time
from collections.abc import Iterator
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from foxglove_client import Client, connected
from linked_fleet_gateway.extensions.foxglove import session
from linked_fleet_gateway.extensions.foxglove.protocol import SUBPROTOCOLS

pytestmark = pytest.mark.virtual
LAB = ("lab-*",)


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded")) as one:
        one.add("lab", *ALL, robots=LAB)
        one.add("watcher", "read", "subscribe")
        one.add("reader", "read")
        one.known("reader")
        yield one


def opened(here: AuthenticatedGateway, name: str = "root", subprotocol: str = SUBPROTOCOLS[0]) -> Client:
    return connected(here.root, here.tokens[name], subprotocol)


@pytest.mark.parametrize("subprotocol", SUBPROTOCOLS)
def test_a_client_is_told_what_there_is_and_decodes_what_it_subscribes_to(
    here: AuthenticatedGateway, subprotocol: str
) -> None:
    client = opened(here, subprotocol=subprotocol)
    with client.socket:
        assert client.socket.subprotocol == subprotocol
        info = client.next("serverInfo")
        assert info["capabilities"] == ["parameters", "parametersSubscribe", "services"]
        topics = [f"/{SEEN}/{each}" for each in ("joint_states", "tf", "pose", "log")] + ["/world/objects"]
        client.subscribe(*topics)
        states, transforms, pose, log, scene = (client.message(id, topic) for id, topic in enumerate(topics))
        assert len(states.joints) == 6 and states.joints[0].name == "shoulder_pan_joint"
        assert {each.parent_frame_id for each in transforms.transforms} == {f"{SEEN}/world"}
        assert f"{SEEN}/wrist_3_link" in {each.child_frame_id for each in transforms.transforms}
        assert pose.pose.orientation.w == 1.0
        assert log.message == "online" and not scene.entities


def test_a_robot_that_the_caller_does_not_see_has_no_channels(here: AuthenticatedGateway) -> None:
    client = opened(here, "lab")
    with client.socket:
        client.subscribe(f"/{SEEN}/joint_states")
        client.message(0, f"/{SEEN}/joint_states")
        assert {each.split("/")[1] for each in client.channels} == {SEEN, "world"}
        assert {each.split("/")[1] for each in client.services} == {SEEN, "stopAll"}
        other = opened(here, "root")
        with other.socket:
            hidden = other.until(lambda: other.channels.get(f"/{HIDDEN}/tf"))["id"]
        client.send("subscribe", subscriptions=[{"id": 9, "channelId": hidden}])
        assert client.next("status")["level"] == 2
        client.send("getParameters", parameterNames=[])
        assert {each["name"].split("/")[1] for each in client.next("parameterValues")["parameters"]} == {SEEN}


@pytest.mark.parametrize(("name", "subprotocol", "status"), [("reader", SUBPROTOCOLS[0], 403), ("root", "x", 406)])
def test_the_handshake_is_refused(here: AuthenticatedGateway, name: str, subprotocol: str, status: int) -> None:
    with pytest.raises(InvalidStatus) as refused:
        opened(here, name, subprotocol)
    assert refused.value.response.status_code == status


def test_a_get_says_that_this_is_a_websocket(here: AuthenticatedGateway) -> None:
    with here.browsing("root") as browser:
        answer = browser.http.get(f"{here.root}foxglove", headers={"accept": "*/*"})
    assert answer.status_code == 426 and "ws://" in answer.text


def test_services_act_with_the_rights_of_the_caller(here: AuthenticatedGateway) -> None:
    client = opened(here)
    with client.socket:
        client.subscribe(f"/{SEEN}/invocations")
        client.call(f"/{SEEN}/stop")
        client.until(lambda: client.responses)
        ((id, said),) = client.responses
        assert id == 7 and said["status"] == 204 and f"/{SEEN}/actions/stop/invocations/" in said["invocation"]
        event = client.message(0, f"/{SEEN}/invocations")
        assert {"action", "state"} <= {each.key for each in event.metadata}
    watcher = opened(here, "watcher")
    with watcher.socket:
        watcher.call(f"/{SEEN}/stop")
        failure = watcher.next("serviceCallFailure")
        assert failure["callId"] == 7 and failure["message"].startswith("403: ")


@pytest.mark.parametrize(
    ("content", "reason"),
    [(b'{"pose": "nowhere"}', "422: "), (b"{", "400: "), (b"[]", "422: "), (b"\xff", "400: "), (b"", "422: ")],
)
def test_a_pose_that_there_is_not_is_refused_with_the_reason(
    here: AuthenticatedGateway, content: bytes, reason: str
) -> None:
    client = opened(here)
    with client.socket:
        client.call(f"/{SEEN}/assumePose", content)
        assert client.next("serviceCallFailure")["message"].startswith(reason)


def test_a_named_pose_is_assumed(here: AuthenticatedGateway) -> None:
    client = opened(here)
    with client.socket:
        service = client.until(lambda: client.services.get(f"/{SEEN}/assumePose"))
        named = json.loads(service["request"]["schema"])["properties"]["pose"]["enum"]
        client.call(f"/{SEEN}/assumePose", json.dumps({"pose": named[0], "speedScale": 0.5}).encode())
        client.until(lambda: client.responses)
        assert client.responses[0][1]["status"] in (200, 201, 202, 204)


def test_parameters_are_read_set_and_followed(here: AuthenticatedGateway) -> None:
    name = f"/{SEEN}/maximumSpeedScale"
    client, other = opened(here), opened(here, "watcher")
    with client.socket, other.socket:
        other.send("subscribeParameterUpdates", parameterNames=[name])
        client.send("getParameters", parameterNames=[name, "/nothing"], id="a")
        said = client.next("parameterValues")
        assert (said["id"], said["parameters"]) == ("a", [{"name": name, "value": 1.0, "type": "float64"}])
        client.send("setParameters", parameters=[{"name": name, "value": 0.5}], id="b")
        assert client.next("parameterValues")["parameters"][0]["value"] == 0.5
        other.until(
            lambda: any(
                each["op"] == "parameterValues" and each["parameters"][0]["value"] == 0.5 for each in other.heard
            )
        )
        client.send("setParameters", parameters=[{"name": name, "value": 7}])
        assert "422" in client.next("status")["message"]
        other.send("setParameters", parameters=[{"name": name, "value": 1}])
        assert "403" in other.next("status")["message"]
        client.send("setParameters", parameters=[{"name": f"/{SEEN}/title", "value": "x"}])
        assert "/title" in client.next("status")["message"]


def test_a_stop_does_not_wait_for_settings_that_take_long(
    here: AuthenticatedGateway, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each setting takes three seconds here; it takes longer if Redis does not answer."""
    name, usual = f"/{SEEN}/maximumSpeedScale", session.ask

    async def slow(request: Any, method: str, *more: Any, **fields: Any) -> Any:
        if method == "PUT":
            await asyncio.sleep(3)
        return await usual(request, method, *more, **fields)

    monkeypatch.setattr(session, "ask", slow)
    client = opened(here)
    with client.socket:
        client.until(lambda: client.services.get(f"/{SEEN}/stop"))
        client.send("setParameters", parameters=[{"name": name, "value": value} for value in (0.5, 0.6)], id="first")
        client.send("setParameters", parameters=[{"name": name, "value": 1.0}], id="second")
        client.call(f"/{SEEN}/stop")
        begun_s = time.monotonic()
        client.until(lambda: client.responses)
        assert time.monotonic() - begun_s < 1
        for id, value in (("first", 0.6), ("second", 1.0)):
            said = client.next("parameterValues")
            assert (said["id"], said["parameters"][0]["value"]) == (id, value), "settings keep their order"


def test_settings_of_one_client_in_progress_are_bounded(
    here: AuthenticatedGateway, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def never(*arguments: Any, **fields: Any) -> Any:
        await asyncio.sleep(1000)

    monkeypatch.setattr(session, "ask", never)
    client = opened(here)
    with client.socket:
        for _ in range(session.MOST_CALLS + 1):
            client.send("setParameters", parameters=[{"name": f"/{SEEN}/maximumSpeedScale", "value": 1.0}])
        assert "Too many" in client.next("status")["message"]


BAD = [
    "", "{", "[]", "null", '{"op": "advertise"}', '{"op": 1}', '{"op": "subscribe", "subscriptions": [{"id": -1}]}',
    '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 4294967296}]}', "[" * 60_000,
    '{"op":"subscribe","x":' + "[" * 50_000,
    '{"op": "setParameters", "parameters": [{"name": "x"}]}', b"", b"\x01\0\0\0\0x", b"\x02", b"\x02" + b"\xff" * 12,
    b"\x02" + bytes(8) + struct.pack("<I", 1) + b"\xff",
    '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 999999}]}',
    '{"op": "subscribe"}', '{"op": "subscribe", "channels": []}', '{"op": "unsubscribe", "ids": [1]}',
    '{"op": "unsubscribe", "subscriptionIds": [77]}', '{"op": "setParameters", "parameterNames": []}',
    '{"op": "subscribeParameterUpdates"}', '{"op": "subscribeParameterUpdates", "parameterNames": ["/nothing"]}',
    '{"op": "unsubscribeParameterUpdates", "names": []}',
]  # fmt: skip


@pytest.mark.parametrize("bad", BAD, ids=range(len(BAD)))
def test_bad_input_gets_the_status_message_of_the_protocol(here: AuthenticatedGateway, bad: str | bytes) -> None:
    client = opened(here)
    with client.socket:
        client.socket.send(bad)
        assert client.next("status")["level"] == 2
        client.send("getParameters", parameterNames=[f"/{SEEN}/title"])
        assert client.next("parameterValues")["parameters"], "the connection goes on"


def test_the_id_of_a_call_under_way_is_refused_and_stops_are_not(
    here: AuthenticatedGateway, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = session.ask

    async def slow(request: Any, method: str, path: str, **fields: Any) -> Any:
        await asyncio.sleep(3)
        return await usual(request, method, path, **fields)

    monkeypatch.setattr(session, "ask", slow)
    client = opened(here)
    with client.socket:
        for content in (b'{"pose": "nowhere"}', b"{}"):
            client.call(f"/{SEEN}/assumePose", content)
        assert "take another one" in client.next("status")["message"]
        assert "nowhere" in client.next("serviceCallFailure")["message"]
        for _ in range(2):
            client.call(f"/{SEEN}/stop")
        client.until(lambda: len(client.responses) == 2)


def test_calls_of_unknown_services_fail(here: AuthenticatedGateway) -> None:
    client = opened(here)
    with client.socket:
        client.socket.send(struct.pack("<BIII", 2, 999_999, 3, 4) + b"json{}")
        assert client.next("serviceCallFailure")["callId"] == 3
        client.call(f"/{SEEN}/stop", encoding=b"cdr")
        assert "json" in client.next("serviceCallFailure")["message"]


@pytest.mark.parametrize("lost", ["all rights", "subscribe", "stop"])
def test_a_connection_ends_when_its_client_loses_a_right(here: AuthenticatedGateway, lost: str) -> None:
    """Also if it may still read, because channels and services were advertised with all its rights."""
    here.add("short", *ALL)
    here.known("short")
    client = opened(here, "short")
    with client.socket:
        client.next("serverInfo")
        if lost == "all rights":
            here.revoke("short")
        else:
            here.tables["short"] = here.tables["short"].replace(f', "{lost}"', "")
            here.write()
        with pytest.raises(ConnectionClosed) as end:
            client.until(lambda: False)
    assert end.value.rcvd is not None and end.value.rcvd.code == 1008
