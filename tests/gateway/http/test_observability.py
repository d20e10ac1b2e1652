"""What an operator sees of a gateway: liveness, readiness, metrics and log."""

import asyncio
import contextlib
import json
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.samples import Sample
from starlette.requests import Request

from browser import HYBRIT, ROS, Browser, Page
from connections import websocket
from fake_robots import FakeRobot, open_session
from linked_fleet_base.faults import Faults
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.world.extension import PREPARING
from linked_fleet_gateway.http.operator_endpoints import ready
from receivers import Answer, receiving
from redis_servers import single
from running import ROOT, Process, eventually, free_port, process
from small_fleet import Place, live, move, presence

pytestmark = pytest.mark.virtual


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway():
        yield place


@pytest.fixture
def http(place: Place) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=place.root, timeout=20) as client:
        eventually(lambda: client.get("/health/ready").status_code == 200, "a gateway that is ready")
        yield client


@contextlib.contextmanager
def gateway(place: Place, *more: str) -> Iterator[tuple[Process, httpx.Client]]:
    with process(*place.command(), *more) as child, httpx.Client(base_url=place.root, timeout=20) as client:
        child.said("serving")
        yield child, client


# -- health -----------------------------------------------------------------------------------------------------------


def test_a_gateway_says_that_it_lives_and_is_ready(http: httpx.Client) -> None:
    for path, status in (("/health/live", "live"), ("/health/ready", "ready")):
        answer = http.get(path)
        assert (answer.status_code, answer.json()) == (200, {"status": status})
        assert answer.headers["cache-control"] == "no-store"
        head = http.head(path)
        assert (head.status_code, head.content) == (200, b"")
        assert head.headers["content-type"] == answer.headers["content-type"] == "application/json"


def test_health_is_answered_under_any_host_and_nothing_else_is(http: httpx.Client) -> None:
    stranger = {"host": "10.1.2.3:8000"}
    assert http.get("/health/live", headers=stranger).status_code == 200
    assert http.get("/", headers=stranger).status_code == 421


def test_health_is_read_only_and_has_nothing_below(http: httpx.Client) -> None:
    refused = http.post("/health/ready", content=b"x")
    assert (refused.status_code, refused.headers["allow"]) == (405, "GET, HEAD, OPTIONS")
    assert http.options("/health/live").headers["allow"] == "GET, HEAD, OPTIONS"
    for path in ("/health", "/health/", "/health/live/", "/health/other"):
        assert http.get(path).status_code == 404, path


def test_a_robot_called_like_an_operators_address_is_found_beside_it(place: Place, http: httpx.Client) -> None:
    names = ("health", "metrics", "health/live")
    with open_session(place.zenoh) as session:
        actors = [FakeRobot(session, name).appear() for name in names]
        paths = ("/~68ealth/", "/~6Detrics/", "/health~2Flive/")
        for path in paths:
            eventually(lambda path=path: http.get(path).status_code == 200, path)
        # referenced until here: they leave when they are garbage-collected
        assert [actor.name for actor in actors] == list(names)
        assert http.get("/health/live").json() == {"status": "live"}


def test_without_redis_a_gateway_lives_and_is_not_ready(tmp_path: Path) -> None:
    with (
        single(tmp_path / "redis") as servers,
        gateway(Place(tmp_path / "state"), "--redis-url", servers.url) as (_, http),
    ):
        eventually(lambda: http.get("/health/ready").status_code == 200, "ready")
        servers.nodes[0].pause()
        assert unready(http) == ["Redis does not answer"]
        assert http.get("/health/live").status_code == 200
        servers.nodes[0].resume()
        eventually(lambda: http.get("/health/ready").status_code == 200, "ready again")


def test_without_anybody_to_connect_to_a_gateway_is_not_ready(tmp_path: Path) -> None:
    elsewhere = f"tcp/127.0.0.1:{free_port()}"
    with gateway(Place(tmp_path), "--zenoh-connect", elsewhere) as (_, http):
        eventually(lambda: unready(http) == ["no robot, router or other gateway is connected by Zenoh"], "its reason")
        with open_session(elsewhere):
            eventually(lambda: http.get("/health/ready").status_code == 200, "ready")
        eventually(lambda: http.get("/health/ready").status_code == 503, "not ready")


# -- metrics ----------------------------------------------------------------------------------------------------------


def test_metrics_are_those_of_this_moment(place: Place, http: httpx.Client) -> None:
    with open_session(place.zenoh) as session:
        before = sample(http, "linked_fleet_frames_taken_total")
        robot = FakeRobot(session, "counted").appear()
        eventually(lambda: http.get("/counted/elbow").status_code == 200, "its joint")
        robot.put("state", robot.frame([0.1]))
        eventually(lambda: sample(http, "linked_fleet_frames_taken_total") == before + 1, "one frame more")
        assert 0 <= sample(http, "linked_fleet_robot_frame_age_seconds", robot="counted") < 60
        malformed = sample(http, "linked_fleet_messages_malformed_total")
        robot.put("state", b"no frame")
        eventually(lambda: sample(http, "linked_fleet_messages_malformed_total") == malformed + 1, "one refused")
        eventually(lambda: sample(http, "linked_fleet_frame_lag_seconds_count") > 0, "a frame whose lag was measured")
    assert sample(http, "linked_fleet_redis_up") == sample(http, "linked_fleet_zenoh_up") == 1


def test_requests_are_counted_by_method_and_class_and_those_of_operators_are_not(http: httpx.Client) -> None:
    def count(method: str, status: str) -> float:
        return sample(http, "linked_fleet_http_requests_total", 0.0, method=method, status=status)

    before = [count("GET", "2xx"), count("GET", "4xx"), count("other", "4xx")]
    http.get("/")
    http.get("/nobody/")
    http.request("BREW", "/")
    http.get("/health/live")
    assert [count("GET", "2xx"), count("GET", "4xx"), count("other", "4xx")] == [each + 1 for each in before]
    assert sample(http, "linked_fleet_http_request_seconds_count", method="other") == before[2] + 1


def test_no_name_of_a_robot_can_write_metrics_of_its_own(place: Place, http: httpx.Client) -> None:
    name = 'a"} 1\nlinked_fleet_redis_up 0\n# \\'
    with open_session(place.zenoh) as session:
        robot = FakeRobot(session, name).appear()

        def probe() -> bool:
            robot.put("state", robot.frame([0.2]))
            return any(each.labels.get("robot") == name for each in samples(http))

        eventually(probe, "the robot under its own name")
    assert [each.value for each in samples(http) if each.name == "linked_fleet_redis_up"] == [1]


def test_commands_streams_and_open_invocations_are_counted(place: Place, http: httpx.Client) -> None:
    with place.ur5(), contextlib.closing(Browser(place.root)) as browser:
        live(browser, "ur5")
        accepted = sample(http, "linked_fleet_commands_total", outcome="accepted")
        timed = sample(http, "linked_fleet_command_acceptance_seconds_count")
        assert move(browser, f"{place.root}ur5/elbow_joint/actions/rotate", 1.0).status_code == 204
        assert sample(http, "linked_fleet_commands_total", outcome="accepted") == accepted + 1
        assert sample(http, "linked_fleet_command_acceptance_seconds_count") == timed + 1
        eventually(lambda: sample(http, "linked_fleet_invocations_open") == 0, "no motion under way")
        with http.stream("GET", "/ur5/", headers={"accept": "text/event-stream"}) as stream:
            assert stream.status_code == 200
            lines = stream.iter_lines()  # dropping it would close the stream
            assert any(line.startswith("data:") for line in lines)
            assert sample(http, "linked_fleet_subscribers", kind="event-stream") == 1
            assert sample(http, "linked_fleet_messages_sent_total") > 0
            assert sample(http, "linked_fleet_messages_rendered_total") > 0
        eventually(lambda: sample(http, "linked_fleet_subscribers", kind="event-stream") == 0, "no stream")
    eventually(lambda: sample(http, "linked_fleet_robots", presence="offline") > 0, "the robot offline")


def test_deliveries_are_counted_and_logged_by_subscription(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with (
        receiving() as receiver,
        gateway(place, "--log-format=json") as (child, http),
        open_session(place.zenoh) as session,
        contextlib.closing(Browser(place.root)) as browser,
    ):
        robot = FakeRobot(session, "toy").appear()
        joint = eventually(lambda: presence(browser, "toy") and _part(browser), "its joint")
        receiver.script(Answer(204), Answer(410))
        body = (
            f"@prefix hybrit: <{HYBRIT}> . [] a hybrit:Subscription, hybrit:WebCallback ; "
            f'hybrit:onResource <{joint.one(ROS.rotation)}> ; hybrit:callbackURL "{receiver.url()}" .'
        )
        container = str(joint.one(HYBRIT.subscriptions))
        made = http.post(container, content=body, headers={"content-type": "text/turtle"})
        assert made.status_code == 201, made.text
        eventually(lambda: sample(http, "linked_fleet_deliveries_total") == 1, "one delivery")
        assert sample(http, "linked_fleet_subscribers", kind="callback") == 1
        robot.put("state", robot.frame([0.5]))
        eventually(lambda: sample(http, "linked_fleet_callbacks_suspended") == 1, "one that is suspended")
        assert sample(http, "linked_fleet_delivery_failures_total") == 1
        id = made.headers["location"].rstrip("/").rpartition("/")[2]
        eventually(lambda: [line for line in log(child) if line.get("subscription") == id], "a line about it")


def _part(browser: Browser) -> Page | None:
    """Return the joint, once the robot is described."""
    try:
        return browser.part("toy", "elbow")
    except (AssertionError, ValueError):
        return None


def samples(http: httpx.Client) -> list[Sample]:
    answer = http.get("/metrics")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    assert answer.headers["cache-control"] == "no-store"
    return [each for family in text_string_to_metric_families(answer.text) for each in family.samples]


def sample(http: httpx.Client, name: str, default: float | None = None, **labels: str) -> float:
    """Return the number of that name with these labels, or the default if there is none."""
    found = [each.value for each in samples(http) if each.name == name and labels.items() <= each.labels.items()]
    if not found and default is not None:
        return default
    (value,) = found
    return value


def test_a_gateway_that_ends_is_not_ready() -> None:
    """Requested on a connection that is still open, since it accepts no new ones."""
    assert reasons(prepared=True, draining=True) == ["the gateway is ending"]


def test_a_gateway_that_prepares_the_check_of_motions_is_not_ready() -> None:
    assert reasons(prepared=False) == [PREPARING]


def test_a_robot_that_joins_takes_no_gateway_away() -> None:
    """The shapes of another robot are prepared while the gateway stays ready: its proxy must still reach stop."""
    gateway = all_well(prepared=True)
    assert answered(gateway) == (200, {"status": "ready"})
    gateway.services.not_ready_reasons = lambda: [PREPARING]
    assert answered(gateway) == (200, {"status": "ready", "warnings": [PREPARING]})


def reasons(*, prepared: bool, draining: bool = False) -> list[str]:
    """Return why a gateway that is otherwise well is not ready."""
    status, answer = answered(all_well(prepared=prepared, draining=draining))
    assert status == 503
    found: list[str] = answer["reasons"]
    return found


def all_well(*, prepared: bool, draining: bool = False) -> SimpleNamespace:
    up = SimpleNamespace(link=SimpleNamespace(is_connected=True), store_is_available=True, faults=Faults())
    reasons = [] if prepared else [PREPARING]
    services = SimpleNamespace(live=up, subscriptions=up, data_warning=str, not_ready_reasons=lambda: reasons)
    return SimpleNamespace(services=services, draining=draining, has_been_ready=False)


def answered(gateway: SimpleNamespace) -> tuple[int, dict[str, Any]]:
    answer = asyncio.run(ready(Request({"type": "http", "app": gateway})))
    return answer.status_code, json.loads(answer.body)


def unready(http: httpx.Client) -> list[str]:
    """Wait until the gateway is not ready, and return why."""

    def probe() -> list[str] | None:
        answer = http.get("/health/ready")
        return answer.json()["reasons"] if answer.status_code == 503 else None

    return eventually(probe, "a gateway that is not ready")


# -- what is drawn and alarmed ----------------------------------------------------------------------------------------


def expressions() -> list[str]:
    """Return the Prometheus expressions of the dashboard and the alerts."""
    dashboard = json.loads((ROOT / "deploy/grafana/dashboard.json").read_text())
    alerts = yaml.safe_load((ROOT / "deploy/prometheus/alerts.yml").read_text())
    asked = [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", ())]
    variables = [each["query"]["query"] for each in dashboard["templating"]["list"] if each["type"] == "query"]
    return [*asked, *variables, *(rule["expr"] for group in alerts["groups"] for rule in group["rules"])]


def test_dashboard_alerts_and_page_name_all_exported_metrics(http: httpx.Client) -> None:
    http.get("/")  # so that each method and status has a value
    text = http.get("/metrics").text
    families = list(text_string_to_metric_families(text))
    declared = {
        name
        for family in families
        for name in (
            [f"{family.name}_{end}" for end in ("bucket", "count", "sum")]
            if family.type == "histogram"
            else [f"{family.name}_total"]
            if family.type == "counter" and not family.name.endswith("_total")
            else [family.name]
        )
    }
    asked = {name for each in expressions() for name in re.findall(r"\b(?:linked_fleet|process)_\w+", each)}
    assert len(asked) > 15
    assert asked <= declared, asked - declared
    ours = {family.name for family in families if family.name.startswith("linked_fleet_")}
    drawn = {re.sub("_(total|bucket)$", "", name) for name in asked}
    assert ours <= drawn, ours - drawn
    page = (ROOT / "docs/OPERATING.md").read_text()
    told = {f"linked_fleet_{name.removesuffix('_total')}" for row in re.findall(r"^\| (`.+?) \|", page, re.M)
            for name in re.findall(r"`([a-z_]+)`", row)}  # fmt: skip
    assert told == ours


def test_expressions_select_and_group_by_labels_that_there_are() -> None:
    known = {
        "instance",
        "job",
        "le",
        "robot",
        "presence",
        "method",
        "status",
        "kind",
        "outcome",
        "code",
        "state",
        "severity",
    }
    for each in expressions():
        selected = set(re.findall(r"(\w+)(?:=~|!=|!~|=)\"", each))
        grouped = {label.strip() for group in re.findall(r"by \(([^)]*)\)", each) for label in group.split(",")}
        assert selected | grouped <= known, each
        assert each.count("(") == each.count(")")


def test_alerts_use_exported_metrics_of_the_scraped_gateways() -> None:
    config = yaml.safe_load((ROOT / "deploy/prometheus/prometheus.yml").read_text())
    (scraped,) = config["scrape_configs"]
    assert {job for each in expressions() for job in re.findall(r'job="([^"]+)"', each)} == {scraped["job_name"]}
    assert all((ROOT / "deploy/prometheus" / name).is_file() for name in config["rule_files"])
    services = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
    (found,) = scraped["dns_sd_configs"]
    assert set(found["names"]) <= set(services)
    assert found["port"] == GatewaySettings().port


# -- the log ----------------------------------------------------------------------------------------------------------


def test_lines_about_a_request_bear_its_id_and_its_robot(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with gateway(place, "--log-format=json") as (child, http), open_session(place.zenoh) as session:
        robot = FakeRobot(session, "mute\nrobot").appear()
        eventually(lambda: http.get("/mute~0Arobot/elbow").status_code == 200, "the robot")
        answer = http.post("/actions/stopAll", headers={"x-request-id": "from-the-front.1"})
        assert (answer.status_code, answer.headers["x-request-id"]) == (504, "from-the-front.1")

        def said(logger: str) -> list[dict[str, str]]:
            lines = [each for each in log(child) if each.get("request") == "from-the-front.1"]
            return [each for each in lines if each["logger"] == logger]

        (line,) = eventually(lambda: said("linked_fleet_runtime.metrics"), "a line about it")
        assert (line["robot"], line["level"]) == (robot.name, "info")
        (noted,) = eventually(lambda: said("gateway.audit"), "a line of the audit")
        assert (noted["what"], noted["target"], noted["outcome"]) == ("POST", "/actions/stopAll", "504")
        assert line["message"] == "robot mute\nrobot: command silent"
        assert datetime.fromisoformat(line["time"]).tzinfo is not None
        assert [each["robot"] for each in log(child) if "appeared" in each["message"]] == [robot.name]


@pytest.mark.parametrize("sent", ["", "two words", "x" * 65, "a/b", "ä"])
def test_a_request_without_a_usable_id_is_given_one(http: httpx.Client, sent: str) -> None:
    answers = [http.get(path, headers={"x-request-id": sent.encode()}) for path in ("/", "/nobody/", "/health/live")]
    given = [answer.headers["x-request-id"] for answer in answers]
    assert len({*given, sent}) == 4
    assert all(re.fullmatch("[0-9a-f]{32}", id) for id in given)


def test_a_handshake_is_answered_with_its_id(http: httpx.Client, place: Place) -> None:
    with websocket(place.root, {"X-Request-Id": "shake"}) as channel:
        assert channel.response is not None
        assert channel.response.headers["x-request-id"] == "shake"
    assert sample(http, "linked_fleet_http_requests_total", method="GET", status="1xx") >= 1


def log(child: Process) -> list[dict[str, str]]:
    """Return the lines of a gateway that logs JSON; all its output but the greeting is JSON."""
    return [json.loads(line) for line in child.output.splitlines() if not line.startswith("serving ")]
