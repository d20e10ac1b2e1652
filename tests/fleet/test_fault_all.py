"""Agent, router, gateway, Redis and front are killed at once: the counterpart of pairs on virtual time."""

from collections.abc import Iterator

import pytest

from redis_servers import single
from running import free_port
from tests.fleet.test_fault_pairs import Fleet, Part, Scene, come_back, started

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    """Run a robot, a router, a gateway and Redis, behind a front that all requests use."""
    endpoint, port, front = f"tcp/127.0.0.1:{free_port()}", free_port(), free_port()
    root = f"http://127.0.0.1:{front}"
    with single(tmp_path_factory.mktemp("redis")) as memory:
        shared = ("--zenoh-connect", endpoint, "--redis-url", memory.url, "--callback-allow", "127.0.0.0/8")
        parts = {
            "router": Part("routing", "tests/support/zenoh_router.py", endpoint),
            "gateway": Part(
                "serving", "-m", "linked_fleet_gateway", "--port", str(port), "--public-url", root, *shared
            ),
            "agent": Part("", "-m", "linked_fleet_agent", "--robot=ur5", "--connect", endpoint),
            "front": Part("forwarding", "tests/support/forwarder.py", str(front), str(port)),
        }
        with started(Fleet(memory, root + "/", parts)) as scene:
            yield scene


@pytest.mark.parametrize(
    "killed", [("router", "Redis"), ("agent", "router", "gateway", "Redis", "front")], ids="+".join
)
def test_restarted_parts_keep_accepted_subscriptions_and_invocations(fleet: Scene, killed: tuple[str, ...]) -> None:
    come_back(fleet, killed)
