"""The spans of a request in a collector: one trace, from the client to the agent."""

import contextlib
import json
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
import zenoh

from browser import LF, Browser
from collector import Collector, collecting
from commanding import TURTLE, expecting, of_joint, of_robot, radian
from fake_robots import KEYS, FakeRobot, open_session
from linked_fleet_agent.wire.codec import decode, decode_reply, encode
from linked_fleet_agent.wire.messages import Accepted, Command, Refused
from receivers import Answer
from running import Process, eventually, process
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
ELBOW = "elbow_joint"
CALLER = "b7ad6b7169203331"
ROTATE, STOP = "POST /{robot}/{joint}/actions/rotate", "POST /{robot}/actions/stop"


@dataclass
class Traced:
    """A fleet with tracing."""

    place: Place
    gateway: Process
    browser: Browser
    collector: Collector

    def post(self, action: str, body: str = "", sampled: str = "01", **headers: str) -> tuple[httpx.Response, str]:
        """Return the response, and the id of the caller's trace."""
        trace = uuid.uuid4().hex
        parent = {"traceparent": f"00-{trace}-{CALLER}-{sampled}"}
        answer = self.browser.http.post(action, content=body, headers=(TURTLE if body else {}) | parent | headers)
        return answer, trace


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Traced]:
    place = Place(tmp_path_factory.mktemp("state"))
    with collecting() as collector, contextlib.ExitStack() as stack:
        with collector.named():
            gateway = stack.enter_context(process(*place.command(), "--log-format=json"))
            stack.enter_context(place.ur5())
        browser = stack.enter_context(contextlib.closing(Browser(place.root)))
        gateway.said("serving")
        live(browser, "ur5")
        yield Traced(place, gateway, browser, collector)


def test_a_motion_is_one_trace_from_the_caller_to_the_agent(traced: Traced) -> None:
    answer, trace = traced.post(of_joint(traced.browser, ELBOW), radian(0.8), **{"x-request-id": "traced.1"})
    assert answer.status_code == 204, answer.text
    names = {ROTATE, "guard", "plan", "send command", "take command"}
    spans = traced.collector.trace(trace, *names)
    assert spans.keys() == names
    request, sent, taken = spans[ROTATE], spans["send command"], spans["take command"]
    assert request.parent == CALLER
    assert {spans[name].parent for name in ("guard", "plan", "send command")} == {request.id}
    assert taken.parent == sent.id
    assert [each.kind for each in (request, sent, taken)] == ["server", "client", "server"]
    assert [each.service for each in (request, sent, taken)] == ["linked-fleet-gateway"] * 2 + ["linked-fleet-agent"]
    assert not any(span.failed for span in spans.values())
    invocation = answer.headers["location"].rstrip("/").rpartition("/")[2]
    assert request.said == {
        "http.request.method": "POST",
        "http.route": "/{robot}/{joint}/actions/rotate",
        "http.response.status_code": 204,
        "url.scheme": "http",
        "url.path": "/ur5/elbow_joint/actions/rotate",
        "linked_fleet.request": "traced.1",
        "linked_fleet.robot": "ur5",
        "linked_fleet.invocation": invocation,
        "linked_fleet.command": invocation,
    }
    told = {"linked_fleet.robot": "ur5", "linked_fleet.command": invocation, "linked_fleet.outcome": "accepted"}
    assert sent.said == told | {"linked_fleet.invocation": invocation}
    assert taken.said == told


def test_a_refused_command_is_marked_and_its_line_in_the_log_names_the_trace(traced: Traced) -> None:
    body = radian(0.8, expecting(f"{traced.place.root}ur5/{ELBOW}", 2.5, 0.01))
    answer, trace = traced.post(of_joint(traced.browser, ELBOW), body)
    assert answer.status_code == 409, answer.text
    spans = traced.collector.trace(trace, ROTATE, "send command", "take command")
    for name in ("send command", "take command"):
        assert spans[name].failed, name
        assert (spans[name].said["linked_fleet.outcome"], spans[name].said["error.type"]) == ("refused", "expectation")
    request = spans[ROTATE]
    assert (request.failed, request.said["http.response.status_code"]) == (False, 409)

    def lines() -> list[dict[str, str]]:
        said = [json.loads(line) for line in traced.gateway.output.splitlines() if line.startswith("{")]
        commands = [line for line in said if line["logger"] == "linked_fleet_runtime.metrics"]
        return [line for line in commands if line.get("trace_id") == trace]

    (line,) = eventually(lines, "a line about it")
    assert line["message"] == "robot ur5: command refused (expectation)"


def test_a_stop_is_traced_and_a_trace_begins_here_where_the_caller_has_none(traced: Traced) -> None:
    stop = of_robot(traced.browser, LF.StopRobot)
    known = {span.trace for span in traced.collector.spans()}
    for fields in ([], [("traceparent", "00-hostile")], [("traceparent", f"00-{'a' * 32}-{CALLER}-01")] * 2):
        assert traced.browser.http.post(stop, headers=fields).status_code == 204

        def begun(known: set[str] = known) -> list[str]:
            return [span.trace for span in traced.collector.spans() if span.name == STOP and span.trace not in known]

        (trace,) = eventually(begun, "a new trace")
        spans = traced.collector.trace(trace, "take stop", "send stop")
        assert spans[STOP].parent == ""
        assert spans["take stop"].parent == spans["send stop"].id
        assert spans["take stop"].said["linked_fleet.outcome"] == "accepted"
        known.add(trace)


def test_reads_and_unsampled_requests_are_not_traced(traced: Traced) -> None:
    stop = of_robot(traced.browser, LF.StopRobot)
    read = uuid.uuid4().hex
    assert (
        traced.browser.http.get(
            traced.place.root + "ur5/", headers={"traceparent": f"00-{read}-{CALLER}-01"}
        ).status_code
        == 200
    )
    _, unrecorded = traced.post(stop, sampled="00")
    _, after = traced.post(stop)
    traced.collector.trace(after, "take stop")
    assert not {read, unrecorded} & {span.trace for span in traced.collector.spans()}


@pytest.mark.parametrize("attachment", [b"", b"\xff\x00", b"00-" + b"0" * 52, b"x" * 1_000_000])
def test_an_agent_answers_with_any_attachment(traced: Traced, attachment: bytes) -> None:
    with open_session(traced.place.zenoh) as session:
        replies = session.get(KEYS.robot("ur5", "command"), payload=b"{}", attachment=attachment)
        (reply,) = [decode_reply(each.ok.payload.to_bytes()) for each in replies if each.ok is not None]
    assert isinstance(reply, Refused)
    assert reply.code == "malformed"


def test_a_robot_that_says_nothing_is_marked(traced: Traced) -> None:
    with open_session(traced.place.zenoh) as session:
        robot = FakeRobot(session, "mute").appear().stand(0.0)
        live(traced.browser, robot.name)
        answer, trace = traced.post(of_joint(traced.browser, "elbow", robot="mute"), radian(0.1))
        assert answer.status_code == 504, answer.text
    spans = traced.collector.trace(trace, ROTATE, "send command")
    assert spans["send command"].failed
    assert spans["send command"].said["linked_fleet.outcome"] == "silent"
    request = spans[ROTATE]
    assert (request.failed, request.said["error.type"]) == (True, "504")


def test_without_a_collector_nothing_is_attached(tmp_path: Path) -> None:
    place, attached = Place(tmp_path), list[zenoh.ZBytes | None]()

    def answer(query: zenoh.Query) -> None:
        attached.append(query.attachment)
        command = decode(query.payload.to_bytes(), Command)
        query.reply(query.key_expr, encode(Accepted(command.id, 1.0, (), 1)))

    with place.gateway() as (_, browser), open_session(place.zenoh) as session:
        robot = FakeRobot(session, "toy").appear().stand(0.0)
        robot.keep(session.declare_queryable(KEYS.robot("toy", "command"), answer, complete=True))
        live(browser, "toy")
        action = of_joint(browser, "elbow", robot="toy")
        parent = {"traceparent": f"00-{'a' * 32}-{CALLER}-01"}
        assert browser.http.post(action, content=radian(0.1), headers=TURTLE | parent).status_code == 204
    assert attached == [None]


@pytest.mark.parametrize(
    ("module", "program"), [("linked_fleet_gateway", "gateway"), ("linked_fleet_agent", "linked-fleet-agent")]
)
def test_without_its_packages_a_process_that_is_to_trace_says_so_and_ends(
    module: str, program: str, tmp_path: Path
) -> None:
    flags = ["--robot=ur5"] if module == "linked_fleet_agent" else list(Place(tmp_path).command()[2:])
    code = f"import sys; sys.modules['opentelemetry'] = None; sys.argv[1:] = {flags}; "
    run = f"{code}from {module}.__main__ import main; sys.exit(main())"
    with collecting() as collector, collector.named(), process("-c", run) as child:
        assert child.ended() == 2
    assert child.output.startswith(f"{program}: OTEL_EXPORTER_OTLP_ENDPOINT is set, but OpenTelemetry is not installed")
    assert child.output.endswith("pip install 'linked-fleet-agent[tracing]'\n")
    assert child.output.count("\n") == 1


@pytest.mark.parametrize("module", ["linked_fleet_gateway", "linked_fleet_agent"])
def test_packages_of_tracing_are_imported_only_if_it_is_on(module: str) -> None:
    """For a gateway only those that export: its Redis client imports the others itself."""
    code = f"import sys, {module}.__main__; sys.exit('opentelemetry.exporter' in sys.modules)"
    with process("-c", code) as child:
        assert child.ended() == 0, child.output


def test_a_process_that_ends_leaves_a_collector_that_does_not_answer(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with collecting() as collector:
        collector.receiver.default = Answer(stalls=True)
        with collector.named(), process(*place.command()) as gateway, place.ur5() as agent:
            gateway.said("serving")
            with contextlib.closing(Browser(place.root)) as browser:
                live(browser, "ur5")
                assert browser.http.post(of_robot(browser, LF.StopRobot)).status_code == 204
            collector.receiver.wait(2)  # of both
            for child in (agent, gateway):
                assert child.stop() == 0
                assert "the collector does not take the last spans; they are lost" in child.output
