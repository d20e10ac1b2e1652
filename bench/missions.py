"""Missions: what the start of a large one costs the event loop, and how fast one step follows the other.

The gateway and the agent are processes of one machine. Times between steps are those that the agent states.
"""

import argparse
import itertools
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import msgspec
import rdflib

from bench.orders import longest_ms
from bench.scene import cpu_s, pid_of
from bench.table import Row, bounded, known, markdown, percentile
from browser import LF, Browser
from linked_fleet_gateway.extensions.missions.mission import Invoke, Mission, Sequence
from linked_fleet_gateway.extensions.missions.progress import settle, with_step
from linked_fleet_gateway.extensions.missions.record import Creator, Run
from running import eventually, process
from small_fleet import Place, live

PROV = rdflib.Namespace("http://www.w3.org/ns/prov#")
RAD = "http://qudt.org/vocab/unit/RAD"
STEPS, LARGE, ROUNDS, STARTS = 60, 100, 50, 20
MOST_START_MS, MOST_STEP_MS = 20.0, 5.0


def rows() -> Iterator[Row]:
    yield from _decisions()
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        yield from _starts(place)
        with place.gateway() as (_, browser), place.ur5(), httpx.Client(timeout=120) as http:
            live(browser, "ur5")
            action = f"{place.root}ur5/wrist_3_joint/actions/rotate"
            client, mission = _of_client(http, action), _of_mission(http, place.root, action)
            what = "from the end of a motion to the begin of the next one"
            for share in (0.5, 0.95):
                one, other = percentile(mission, share), percentile(client, share)
                yield known(f"{what}, p{share * 100:.0f}", "ms", one, "a client that waits and posts", other)
            more_ms = percentile(mission, 0.5) - percentile(client, 0.5)
            yield bounded(f"{what}, p50, more than that of the client", "ms", more_ms, MOST_STEP_MS)


def _decisions() -> Iterator[Row]:
    """Measure in processor time what a run of a hundred steps costs at its start, and at each step."""
    step = Sequence(tuple(Invoke(action=f"http://a/r/actions/x{number}") for number in range(LARGE)))
    run = Run(Mission("m", step), "/missions/1", "http://a", {}, Creator(), 0)

    def start() -> Run:
        begun, _ = settle(run, 1)
        msgspec.json.encode(begun)
        return begun

    yield bounded(f"start of a run of {LARGE} steps, processor time", "ms", _cpu_ms(start), MOST_START_MS)
    half = start()
    for number in range(LARGE // 2):
        done = msgspec.structs.replace(half.steps[f"0.{number}"], state="succeeded")
        half, _ = settle(with_step(half, f"0.{number}", done), 1)
    yield known("a step in its middle, processor time", "ms", _cpu_ms(lambda: msgspec.json.encode(settle(half, 1)[0])))


def _starts(place: Place) -> Iterator[Row]:
    """Measure the whole start by HTTP: its checks, leases and records. The run then waits for a person."""
    with (
        process("-m", "bench.timed_gateway", *place.command()[2:], "--requests-per-client", "0") as gateway,
        place.ur5(),
        httpx.Client(timeout=60) as http,
    ):
        gateway.said("serving")
        live(Browser(place.root), "ur5")
        for value, bodies in ((0.1, "fixed bodies"), ({"variable": "angle"}, "bodies with a parameter each")):
            mission = _waiting(http, place.root, value)
            spent, longest = list[float](), list[float]()
            for _ in range(STARTS):
                longest_ms(gateway)
                before_s = cpu_s(pid_of(gateway))
                begun = http.post(f"{mission}/actions/run", json={}).raise_for_status().headers["location"]
                spent.append((cpu_s(pid_of(gateway)) - before_s) * 1000)
                longest.append(longest_ms(gateway))
                http.post(f"{begun}/actions/cancel").raise_for_status()
            name = f"POST that starts a run of {LARGE} steps, {bodies}"
            yield bounded(f"{name}: processor of the gateway, mean", "ms", sum(spent) / STARTS, MOST_START_MS)
            yield bounded(f"{name}: longest callback, median", "ms CPU", percentile(longest, 0.5), MOST_STEP_MS)


def _waiting(http: httpx.Client, root: str, value: object) -> str:
    """Write a mission that asks a person before its other steps."""
    body = {"value": value, "unit": RAD}
    step = {"type": "invoke", "action": f"{root}ur5/wrist_3_joint/actions/rotate", "body": body}
    parameter = {"name": "angle", "type": "number", "minimum": 0, "maximum": 1, "default": 0.2}
    steps = [{"type": "confirm", "text": "Go on?"}, *[step] * LARGE]
    said = {"title": "large", "parameters": [parameter], "step": {"type": "sequence", "steps": steps}}
    written: str = http.post(f"{root}missions", json=said).raise_for_status().headers["location"]
    return written


def _cpu_ms(work: Any) -> float:
    before_s = time.thread_time()
    for _ in range(ROUNDS):
        work()
    return (time.thread_time() - before_s) / ROUNDS * 1000


def _angles() -> Iterator[float]:
    return itertools.islice(itertools.cycle((0.01, 0.0)), STEPS)


def _of_client(http: httpx.Client, action: str) -> list[float]:
    """Move as often as the mission, each time after the end of the last motion. Return the times between, in ms."""
    fields, invocations = {"prefer": "wait=10"}, []
    for angle in _angles():
        answer = http.post(action, json={"value": angle, "unit": RAD}, headers=fields).raise_for_status()
        invocations.append(answer.headers["location"])
    return _between(http, invocations)


def _turtle(http: httpx.Client, url: str) -> str:
    return http.get(url, headers={"accept": "text/turtle"}).text


def _of_mission(http: httpx.Client, root: str, action: str) -> list[float]:
    """Run a mission of motions. Return the times between the end of one and the begin of the next one in ms."""
    steps = [{"type": "invoke", "action": action, "body": {"value": angle, "unit": RAD}} for angle in _angles()]
    said = {"title": "to and fro", "step": {"type": "sequence", "steps": steps}}
    mission = http.post(f"{root}missions", json=said).raise_for_status().headers["location"]
    begun = http.post(f"{mission}/actions/run").raise_for_status().headers["location"]
    run = f"{root}mission-runs/{begun.rpartition('/')[2]}"
    eventually(lambda: "lf:succeeded" in _turtle(http, begun), "the end of the run")
    graph = rdflib.Graph().parse(data=_turtle(http, run), format="turtle")
    nodes = sorted(graph.subjects(rdflib.RDF.type, LF.StepRun), key=lambda each: _number(graph, each))
    return _between(http, [str(graph.value(each, LF.invocation)) for each in nodes])


def _between(http: httpx.Client, invocations: list[str]) -> list[float]:
    """Return the times from the end of each invocation to the begin of the next one in ms."""
    graphs = [rdflib.Graph().parse(data=_turtle(http, each), format="turtle") for each in invocations]
    times = [[_at(each, stamp) for stamp in (PROV.startedAtTime, PROV.endedAtTime)] for each in graphs]
    return [1000 * (after[0] - before[1]) for before, after in itertools.pairwise(times)]


def _number(graph: rdflib.Graph, node: Any) -> int:
    return int(str(graph.value(node, LF.stepPath)).rpartition(".")[2])


def _at(graph: rdflib.Graph, predicate: rdflib.URIRef) -> float:
    (stamp,) = graph.objects(None, predicate)
    assert isinstance(stamp, rdflib.Literal)
    at: float = stamp.toPython().timestamp()
    return at


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.missions", description=__doc__)
    parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    print(markdown(list(rows())))


if __name__ == "__main__":
    main()
