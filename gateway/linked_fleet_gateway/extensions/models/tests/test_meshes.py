"""Meshes in the gateway's memory: requested once, checked, bounded."""

import asyncio
import hashlib

import pytest

from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_base.errors import AgentTimeout, Busy, Offline
from linked_fleet_gateway.extensions.models import meshes
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_link.fleet_link import NoAnswer
from linked_fleet_state.events import Frames
from linked_fleet_state.robot import Robot


def _mesh(content: bytes) -> Mesh:
    return Mesh(uri="a.stl", sha256=hashlib.sha256(content).hexdigest(), size=len(content), type="model/stl")


class Agents:
    """Robots that answer with their contents, once ``open`` is set."""

    def __init__(self, *contents: bytes) -> None:
        self.contents = {hashlib.sha256(each).hexdigest(): each for each in contents}
        self.asked: list[tuple[str, str]] = []
        self.answering = self.most_at_once = 0
        self.open = asyncio.Event()
        self.open.set()
        self.meshes = Meshes(self._ask)

    async def _ask(self, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        self.asked.append((robot, mesh.sha256))
        self.answering += 1
        self.most_at_once = max(self.most_at_once, self.answering)
        try:
            await self.open.wait()
        finally:
            self.answering -= 1
        if mesh.sha256 not in self.contents:
            raise NoAnswer("it has none such")
        return self.contents[mesh.sha256]


def _robot(name: str = "r", online: bool = True) -> Robot:
    robot = Robot(name, lambda *_: None, Frames())
    robot.set_online(online)
    return robot


async def test_concurrent_requests_query_the_robot_once() -> None:
    agents, mesh = Agents(b"one"), _mesh(b"one")
    got = await asyncio.gather(*(agents.meshes.get(_robot(), mesh) for _ in range(20)))
    assert set(got) == {b"one"}
    assert await agents.meshes.get(_robot(), mesh) == b"one"
    assert len(agents.asked) == 1


async def test_a_cancelled_request_does_not_cancel_others() -> None:
    agents, mesh = Agents(b"one"), _mesh(b"one")
    agents.open.clear()
    first, second = (asyncio.create_task(agents.meshes.get(_robot(), mesh)) for _ in range(2))
    while not agents.answering:  # noqa: ASYNC110 - there is no event to wait for
        await asyncio.sleep(0)
    first.cancel()
    agents.open.set()
    assert await second == b"one"


async def test_other_bytes_than_were_described_are_refused_and_not_kept() -> None:
    agents, mesh = Agents(), _mesh(b"right")
    agents.contents[mesh.sha256] = b"wrong"
    for _ in range(2):
        with pytest.raises(AgentTimeout, match="other bytes"):
            await agents.meshes.get(_robot(), mesh)
    agents.contents[mesh.sha256] = b"right"
    assert await agents.meshes.get(_robot(), mesh) == b"right"


async def test_no_answer_says_why() -> None:
    with pytest.raises(AgentTimeout, match="it has none such"):
        await Agents().meshes.get(_robot(), _mesh(b"one"))


async def test_cached_meshes_of_an_offline_robot_are_served() -> None:
    agents, offline = Agents(b"one", b"two"), _robot(online=False)
    await agents.meshes.get(_robot(), _mesh(b"one"))
    assert await agents.meshes.get(offline, _mesh(b"one")) == b"one"
    with pytest.raises(Offline):
        await agents.meshes.get(offline, _mesh(b"two"))
    assert len(agents.asked) == 1


async def test_memory_is_bounded_and_the_one_not_used_for_longest_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "MAX_HELD_BYTES", 10)
    agents = Agents(b"aaaa", b"bbbb", b"cccc", b"larger than all")
    for content in (b"aaaa", b"bbbb", b"aaaa", b"cccc"):
        await agents.meshes.get(_robot(), _mesh(content))
    offline = _robot(online=False)
    assert await agents.meshes.get(offline, _mesh(b"aaaa")) == b"aaaa"
    with pytest.raises(Offline):
        await agents.meshes.get(offline, _mesh(b"bbbb"))
    assert await agents.meshes.get(_robot(), _mesh(b"larger than all")) == b"larger than all"
    with pytest.raises(Offline):
        await agents.meshes.get(offline, _mesh(b"larger than all"))


async def test_a_silent_robot_delays_nobody_and_excess_requests_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "MAX_UNDER_WAY", 12)
    monkeypatch.setattr(meshes, "MAX_UNDER_WAY_OF_A_ROBOT", 11)
    contents = [b"%d" % number for number in range(13)]
    agents = Agents(*contents)
    agents.open.clear()
    waiting = [asyncio.create_task(agents.meshes.get(_robot("silent"), _mesh(each))) for each in contents[:11]]
    while len(agents.asked) < 2:  # noqa: ASYNC110 - as above
        await asyncio.sleep(0)
    with pytest.raises(Busy):
        await agents.meshes.get(_robot("silent"), _mesh(contents[12]))
    other = asyncio.create_task(agents.meshes.get(_robot("other"), _mesh(contents[11])))
    while ("other", _mesh(contents[11]).sha256) not in agents.asked:  # noqa: ASYNC110 - as above
        await asyncio.sleep(0)
    assert len(agents.asked) == 3
    with pytest.raises(Busy):
        await agents.meshes.get(_robot("other"), _mesh(contents[12]))
    agents.open.set()
    assert await asyncio.gather(*waiting, other) == contents[:12]
    assert agents.most_at_once <= 8
