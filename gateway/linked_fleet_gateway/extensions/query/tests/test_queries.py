"""Queries from other parts of the gateway: about one instant, within a view, and within their limits."""

import asyncio
import math
import os
import signal
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest
from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_base.contributions import set_present
from linked_fleet_base.errors import BadRequest, FleetError
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.extensions import BUILT_IN, contributions_of
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.query.messages import HypotheticalRobot
from linked_fleet_gateway.extensions.query.service import Queries, Term
from linked_fleet_gateway.extensions.query.turns import QueryTooCostly, ResultTooLarge
from linked_fleet_gateway.resources.branches import FleetBranch, RequestView
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_identity.rights import ALL, View
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.kinematics import ORIGIN
from linked_fleet_state.model import Pose
from mirrored_fleet import MirroredFleet
from running import eventually
from virtual.loop import VirtualLoop, current
from virtual.zenoh_network import ZenohNetwork

pytestmark = pytest.mark.virtual
BASE = "http://fleet.example"
PREFIXES = """PREFIX lf: <https://w3id.org/linked-fleet#> PREFIX ros: <http://ros.org/#>
PREFIX dcterms: <http://purl.org/dc/terms/> PREFIX vom: <http://vocab.arvida.de/2015/06/vom/vocab#>
PREFIX spatial: <http://vocab.arvida.de/2015/06/spatial/vocab#>
"""
POSITIONS = """SELECT ?robot ?position {
    ?joint dcterms:isPartOf/dcterms:title ?robot ; ros:rotation/spatial:rotationAngle/vom:numericalValue ?position }"""
COSTLY = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
ONE = View.of(frozenset({"a"}), "ann")


@dataclass
class Asking:
    """Queries about robots announced by the test; ``run`` executes in the event loop of both."""

    loop: VirtualLoop
    live: Live
    queries: Queries
    robots: MirroredFleet

    def run(self, query: str, sees: View = ALL, bindings: Mapping[str, Term] = {}) -> list[dict[str, Term]]:
        return self.loop.run(self.select(query, sees, bindings))

    async def select(self, query: str, sees: View = ALL, bindings: Mapping[str, Term] = {}) -> list[dict[str, Term]]:
        return await self.queries.select(PREFIXES + query, BASE, sees, bindings)

    def values(self, query: str, sees: View = ALL) -> list[tuple[str, ...]]:
        return sorted(tuple(term.value for term in row.values()) for row in self.run(query, sees))


@pytest.fixture(scope="module")
def asking() -> Iterator[Asking]:
    loop = current()
    assert loop is not None
    set_present(contributions_of(BUILT_IN))

    async def enter() -> tuple[Live, Queries]:
        live = await create_live(GatewaySettings(), ZenohNetwork().gateway("queries")).__aenter__()
        return live, await Queries(live, limit_s=0.5).__aenter__()

    live, queries = loop.run(enter())
    robots = MirroredFleet(live.fleet, live.invocations)
    for name in ("a", "b"):
        robots.describe(name)
        robots.stand(name, (0.25, 0.1))
    yield Asking(loop, live, queries, robots)
    loop.run(queries.__aexit__(None, None, None))
    loop.run(live.__aexit__(None, None, None))


def test_the_whole_fleet_is_asked(asking: Asking) -> None:
    assert asking.values(POSITIONS) == [("The a", "0.25"), ("The b", "0.25")]


def test_each_query_sees_one_instant(asking: Asking) -> None:
    """Both robots always have the same position, which changes constantly."""
    seen: list[set[str]] = []

    async def ask() -> None:
        for _ in range(4):
            rows = await asking.select(POSITIONS)
            assert len(rows) == 2
            seen.append({row["position"].value for row in rows})

    async def move() -> None:
        queries = asyncio.gather(ask(), ask())
        step = 0
        while not queries.done():
            step += 1
            for name in ("a", "b"):
                asking.robots.stand(name, (step % 1000 / 1000, 0.1))
            await asyncio.sleep(0)
        await queries

    asking.loop.run(move())
    assert [len(each) for each in seen] == [1] * 8
    assert len(set.union(*seen)) > 1


def test_queries_exclude_invisible_robots(asking: Asking) -> None:
    assert {row[0] for row in asking.values(POSITIONS, ONE)} == {"The a"}
    for hidden in ("b", "nobody"):
        graph = f"<{BASE}/{hidden}/>"
        for query in (
            f"SELECT ?p {{ GRAPH {graph} {{ ?s ?p ?o }} }}",
            f"SELECT ?p FROM {graph} {{ ?s ?p ?o }}",
            f"SELECT ?p {{ {graph} ?p ?o }}",
            f"SELECT ?p {{ ?s ?p {graph} }}",
            f"SELECT ?p {{ BIND(lf:canReach(<{BASE}/{hidden}/tip>, 0, 0, 1) AS ?p) FILTER(BOUND(?p)) }}",
        ):
            assert asking.run(query, ONE) == [], query
    text = "SELECT ?s { ?s ?p ?o FILTER(CONTAINS(CONCAT(STR(?s), ' ', STR(?o)), '/b/')) }"
    assert asking.run(text, ONE) == []
    assert asking.run(text)


def test_a_function_says_what_can_be_reached(asking: Asking) -> None:
    near = "SELECT ?near { BIND(lf:canReach(<http://fleet.example/a/tip>, 0, 0, %s) AS ?near) }"
    assert asking.values(near % "3.5") == [("true",)]
    assert asking.values(near % "7") == [("false",)]
    assert asking.values(near % "'up'") == [()]


def test_functions_say_where_a_thing_is_seen_from_another_and_how_far(asking: Asking) -> None:
    """Across robots once both are placed; two parts of one robot need no placement."""
    robots, half = asking.live.fleet.robots, math.sqrt(0.5)
    tip, other, crate = (f"<{BASE}/{path}>" for path in ("a/tip", "b/", "world/objects/crate"))
    poses = {"/world": ORIGIN, "/world/objects/crate": Pose((0.0, 0.0, 3.0), (0.0, 0.0, 0.0, 1.0))}
    asking.live.add_branches(FleetBranch("world", None, lambda view, rest: None, poses=lambda: poses))

    def pose(of: str, frame: str) -> list[float]:
        terms = " ".join(f'(lf:poseIn({of}, {frame}, "{each}") AS ?{each})' for each in ("x", "y", "z", "qz", "qw"))
        return [float(term.value) for row in asking.run(f"SELECT {terms} {{}}") for term in row.values()]

    def apart(one: str, two: str) -> list[tuple[str, ...]]:
        return asking.values(f"SELECT (lf:distance({one}, {two}) AS ?d) {{}}")

    for name in ("a", "b"):
        asking.robots.stand(name, (0.0, 0.0))
    try:
        in_own = pose(tip, f"<{BASE}/a/>")
        assert len(in_own) == 5 and apart(tip, f"<{BASE}/a/>")
        assert pose(tip, other) == [] and apart(tip, other) == [()]
        place = {"a": Pose((1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), "b": Pose((1.0, 2.0, 0.0), (0.0, 0.0, half, half))}
        for name, at in place.items():
            asking.live.fleet.configure(name, {"placement": msgspec.json.encode(at).decode()})
        x, y, z = in_own[:3]
        assert pose(tip, other) == pytest.approx([y - 2.0, -x, z, -half, half], abs=1e-4)
        assert float(apart(f"<{BASE}/a/>", other)[0][0]) == pytest.approx(2.0)
        assert float(apart(crate, f"<{BASE}/world>")[0][0]) == pytest.approx(3.0)
        for wrong in (f"<{BASE}/nobody/>", "<http://elsewhere/>", "4", f"<{BASE}/a/elbow>"):
            assert apart(tip, wrong) == [()]
        rows = asking.run(f'SELECT (lf:poseIn({tip}, {other}, "w") AS ?d) (lf:poseIn({tip}) AS ?e) {{}}')
        assert rows == [{}]
        # the view does not include it
        assert asking.run(f"SELECT (lf:distance({tip}, {other}) AS ?d) {{}}", ONE) == [{}]
    finally:
        for name in robots:
            asking.live.fleet.configure(name, {})


def test_robots_can_be_supposed_to_be_in_another_state(asking: Asking) -> None:
    """That counts for this query only."""
    for name in ("a", "b"):
        asking.robots.stand(name, (0.25, 0.1))
    motion = Invocation("1", "a", "/a/elbow/actions/rotate", {"elbow": 1.0}, 1, 2)
    asking.live.invocations.add(motion)
    tasks = "SELECT ?robot { ?of lf:currentTask ?task ; dcterms:title ?robot }"
    instead = HypotheticalRobot(robot="a", joints={"elbow": (0.75, 0.0, 0.0)}, targets={}, motions={"1": None})

    async def suppose(query: str) -> list[tuple[str, ...]]:
        rows = await asking.queries.select(PREFIXES + query, BASE, ALL, instead=[instead])
        return sorted(tuple(term.value for term in row.values()) for row in rows)

    try:
        assert asking.loop.run(suppose(POSITIONS)) == [("The a", "0.75"), ("The b", "0.25")]
        assert asking.loop.run(suppose(tasks)) == []
        assert asking.values(POSITIONS) == [("The a", "0.25"), ("The b", "0.25")]
        assert asking.values(tasks) == [("The a",)]
    finally:
        asking.live.invocations.remove("1")


def test_bindings_stand_for_variables(asking: Asking) -> None:
    robot = NamedNode(f"{BASE}/b/")
    rows = asking.run("SELECT ?robot ?title { ?robot a lf:Robot ; dcterms:title ?title }", bindings={"robot": robot})
    assert rows == [{"robot": robot, "title": Literal("The b")}]
    with pytest.raises(BadRequest):
        asking.run("SELECT ?title { ?robot dcterms:title ?title }", bindings={"robot": robot})


def test_a_query_is_checked_without_being_asked(asking: Asking) -> None:
    async def check(query: str) -> list[str]:
        return await asking.queries.check(query, BASE)

    assert asking.loop.run(check("SELECT ?s { ?s ?p ?o }")) == ["s"]
    with pytest.raises(BadRequest):
        asking.loop.run(check("SELECT ?s { ?s ?p }"))


@pytest.mark.parametrize(
    ("query", "error"),
    [
        (COSTLY, QueryTooCostly),
        (
            "SELECT (COUNT(?x) AS ?n) { ?x (<a:a>|!<a:a>)*/(<a:b>|!<a:b>)*/(<a:c>|!<a:c>)* ?y . ?z ?p ?w }",
            QueryTooCostly,
        ),
        ("SELECT (1" + "+1" * 9000 + " AS ?x) {}", QueryTooCostly),
        ("SELECT ?s {" + "OPTIONAL { ?s ?p ?o }" * 1400 + "}", QueryTooCostly),
        ("SELECT (GROUP_CONCAT(CONCAT(STR(?a), STR(?b))) AS ?x) { ?a ?p ?q . ?b ?r ?t }", QueryTooCostly),
        ("SELECT ?s ?p ?o ?x { ?s ?p ?o VALUES ?x { 1 2 3 4 5 6 7 8 9 } }", ResultTooLarge),
        ("SELECT ?s { ?s ?p }", BadRequest),
        ("SELECT ?s { BIND(<relative > AS ?s) }", BadRequest),
    ],
)
def test_a_query_that_costs_too_much_disturbs_nobody(asking: Asking, query: str, error: type[FleetError]) -> None:
    with pytest.raises(error):
        asking.run(query)
    assert len(asking.run(POSITIONS)) == 2


def test_a_lost_process_is_replaced(asking: Asking) -> None:
    def children() -> list[int]:
        said = Path(f"/proc/self/task/{os.getpid()}/children").read_text()
        lines = {int(each): Path(f"/proc/{each}/cmdline").read_bytes() for each in said.split()}
        return [child for child, line in lines.items() if b"linked_fleet_gateway.extensions.query.worker" in line]

    asking.run(POSITIONS)
    (before,) = children()
    os.kill(before, signal.SIGKILL)
    eventually(lambda: _answers(lambda: asking.select(POSITIONS), asking), "an answer of another process")
    assert children() != [before]


def _answers(ask: Callable[[], Awaitable[list[dict[str, Term]]]], asking: Asking) -> bool:
    async def answered() -> bool:
        try:
            return len(await ask()) == 2
        except FleetError:
            return False

    return asking.loop.run(answered())


def test_branches_state_their_resources_for_the_view(asking: Asking) -> None:
    place = NamedNode("http://world.example/place")

    def contribution(seen_by: RequestView) -> list[tuple[str, list[Triple]]]:
        return [(f"/{name}/", [Triple(seen_by.iri(f"/{name}/"), place, Literal(name))]) for name in seen_by.robots]

    asking.live.add_branches(FleetBranch("places", None, lambda view, rest: None, graphs=contribution))
    query = f"SELECT ?name {{ GRAPH ?robot {{ ?robot <{place.value}> ?name }} }}"
    assert asking.values(query) == [("a",), ("b",)]
    assert asking.values(query, ONE) == [("a",)]
