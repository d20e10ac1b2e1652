"""Two gateways with three arms, and a mission of ten steps of which each is taken once, whatever happens to them."""

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rdflib

from browser import LDP, LF
from gateway_group import Gateway, Hub, gateways, hub
from redis_servers import Servers, single
from running import Process, eventually, process
from small_fleet import live

RAD = "http://qudt.org/vocab/unit/RAD"
ROBOTS = ("a", "b", "c")
TURNS = Counter({"a": 3, "b": 2, "c": 4})
"""How often a run of the mission turns a joint of each arm."""
NEVER_BEGUN = "the agent knows no such motion"
LASTS_S = 16.0
"""Longer than the mission takes."""


@dataclass
class MissionFleet:
    """The gateways, the arms, and what a client asks and sees."""

    memory: Servers
    hub: Hub
    agents: Process
    one: Gateway
    other: Gateway

    def turn(self, robot: str, angle: float) -> dict[str, Any]:
        action = f"{self.one.browser.root}{robot}/wrist_3_joint/actions/rotate"
        return {"type": "invoke", "action": action, "body": {"value": angle, "unit": RAD}}

    def ten_steps(self) -> dict[str, Any]:
        """Return turns one after the other and at the same time, and waits between them."""
        all_ = [self.turn(each, 0.2) for each in ROBOTS]
        back = [self.turn(each, 0.0) for each in ROBOTS]
        return {
            "type": "sequence",
            "steps": [
                self.turn("a", 0.1),
                {"type": "parallel", "steps": all_},
                {"type": "wait", "seconds": 1},
                {"type": "firstOf", "steps": [{"type": "parallel", "steps": back}, self.turn("b", 1.0)]},
                {"type": "repeat", "times": 2, "step": self.turn("c", 0.1)},
            ],
        }

    def begin(self, times: int = 1) -> str:
        """Post the mission and run it so many times. Return the path of the run."""
        step = self.ten_steps()
        return self.begin_with({"type": "repeat", "times": times, "step": step} if times > 1 else step)

    def begin_with(self, step: dict[str, Any]) -> str:
        """Post a mission of this step and run it. Return the path of the run."""
        http = self.one.browser.http
        said = {"title": "ten steps", "step": step}
        mission = http.post(self.one.browser.root + "missions", json=said).headers["location"]
        begun = http.post(mission + "/actions/run")
        assert begun.status_code == 204, begun.text
        path = "mission-runs/" + begun.headers["location"].rpartition("/")[2]
        eventually(lambda: len(self.described(path)) > 0, "the run at the other gateway")
        return path

    def described(self, path: str, gateway: Gateway | None = None) -> rdflib.Graph:
        at = gateway or self.other
        answer = at.get(at.browser.root + path)
        return rdflib.Graph().parse(data=answer.text if answer.status_code == 200 else "", format="turtle")

    def taken(self) -> Counter[str]:
        """Return how often each arm was told to turn, whoever asked, and perhaps has."""
        found = Counter[str]()
        for robot in ROBOTS:
            url = f"{self.other.browser.root}{robot}/wrist_3_joint/actions/rotate/invocations"
            all_ = [str(each) for each in self.other.browser.page(url).graph.objects(None, LDP.contains)]
            found[robot] = sum(NEVER_BEGUN not in self.other.get(each).text for each in all_)
        return found

    def succeeds(self, path: str, gateway: Gateway | None = None) -> None:
        at = gateway or self.other
        run = rdflib.URIRef(at.browser.root + path)
        eventually(lambda: (run, LF.state, LF.succeeded) in self.described(path, at), lambda: at.get(str(run)).text)


@contextlib.contextmanager
def mission_fleet(
    folder: Path, servers: Callable[[Path], AbstractContextManager[Servers]] = single
) -> Iterator[MissionFleet]:
    """Run the gateways and the arms until both gateways know all arms."""
    with servers(folder) as memory, hub() as centre, contextlib.ExitStack() as stack:
        names = [f"--robot={each}=ur5" for each in ROBOTS]
        agents = stack.enter_context(process("-m", "linked_fleet_agent", *names, "--connect", centre.endpoint))
        one, other = stack.enter_context(gateways(centre, memory.url))
        for each in ROBOTS:
            live(one.browser, each)
            live(other.browser, each)
        yield MissionFleet(memory, centre, agents, one, other)
