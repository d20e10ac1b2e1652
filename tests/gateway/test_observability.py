"""What an operator sees of a gateway: whether it lives, whether it is ready, what it counts and what it writes."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import zenoh
from actor import Actor, stage
from browser import Browser
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.samples import Sample
from redis_servers import Server
from running import Process, eventually, free_port, process
from small_fleet import Place, live, move


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
    with stage(place.zenoh) as session:
        actors = [Actor(session, name).appear() for name in names]
        paths = ("/~68ealth/", "/~6Detrics/", "/health~2Flive/")
        for path in paths:
            eventually(lambda path=path: http.get(path).status_code == 200, path)
        assert [actor.name for actor in actors] == list(names)  # held until here: they go when they are dropped
        assert http.get("/health/live").json() == {"status": "live"}


def test_without_redis_a_gateway_lives_and_is_not_ready(tmp_path: Path) -> None:
    server = Server(tmp_path / "redis")
    server.start()
    try:
        with gateway(Place(tmp_path / "state"), "--redis-url", server.url) as (_, http):
            eventually(lambda: http.get("/health/ready").status_code == 200, "ready")
            server.pause()
            reasons = unready(http)
            assert reasons == ["Redis does not answer"]
            assert http.get("/health/live").status_code == 200
            server.resume()
            eventually(lambda: http.get("/health/ready").status_code == 200, "ready again")
    finally:
        server.discard()


def test_without_anybody_to_connect_to_a_gateway_is_not_ready(tmp_path: Path) -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    with gateway(Place(tmp_path), "--zenoh-connect", router) as (_, http):
        eventually(lambda: unready(http) == ["no robot, router or other gateway is connected by Zenoh"], "its reason")
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([router]))
        config.insert_json5("scouting/multicast/enabled", "false")
        with zenoh.open(config):
            eventually(lambda: http.get("/health/ready").status_code == 200, "ready")
        eventually(lambda: http.get("/health/ready").status_code == 503, "not ready")


# -- metrics ----------------------------------------------------------------------------------------------------------


def test_metrics_are_those_of_this_moment(place: Place, http: httpx.Client) -> None:
    with stage(place.zenoh) as session:
        before = sample(http, "linked_fleet_frames_taken_total")
        robot = Actor(session, "counted").appear()
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
    with stage(place.zenoh) as session:
        robot = Actor(session, name).appear()

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
            next(stream.iter_lines())
            assert sample(http, "linked_fleet_subscribers", kind="event-stream") == 1
            assert sample(http, "linked_fleet_messages_sent_total") > 0
            assert sample(http, "linked_fleet_messages_rendered_total") > 0
        eventually(lambda: sample(http, "linked_fleet_subscribers", kind="event-stream") == 0, "no stream")
    eventually(lambda: sample(http, "linked_fleet_robots", presence="offline") > 0, "the robot offline")


def samples(http: httpx.Client) -> list[Sample]:
    answer = http.get("/metrics")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    assert answer.headers["cache-control"] == "no-store"
    return [each for family in text_string_to_metric_families(answer.text) for each in family.samples]


def sample(http: httpx.Client, name: str, default: float | None = None, **labels: str) -> float:
    """The one number of that name with these labels, or the default where there is none."""
    found = [each.value for each in samples(http) if each.name == name and labels.items() <= each.labels.items()]
    if not found and default is not None:
        return default
    (value,) = found
    return value


def unready(http: httpx.Client) -> list[str]:
    """Why the gateway is not ready, as soon as it is not."""

    def probe() -> list[str] | None:
        answer = http.get("/health/ready")
        return answer.json()["reasons"] if answer.status_code == 503 else None

    return eventually(probe, "a gateway that is not ready")
