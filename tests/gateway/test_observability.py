"""What an operator sees of a gateway: whether it lives, whether it is ready, what it counts and what it writes."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import zenoh
from actor import Actor
from redis_servers import Server
from running import Process, eventually, free_port, process
from small_fleet import Place


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
    with zenoh.open(client_of(place)) as session:
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


def unready(http: httpx.Client) -> list[str]:
    """Why the gateway is not ready, as soon as it is not."""

    def probe() -> list[str] | None:
        answer = http.get("/health/ready")
        return answer.json()["reasons"] if answer.status_code == 503 else None

    return eventually(probe, "a gateway that is not ready")


def client_of(place: Place) -> zenoh.Config:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([place.zenoh]))
    return config
