"""Fingerprints of requests, by which a plan belongs to one; and plans in Redis."""

import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest
from pyoxigraph import BlankNode, NamedNode, RdfFormat, Triple, parse

from linked_fleet_agent.wire.messages import Follow
from linked_fleet_gateway.api import Body, Pose
from linked_fleet_gateway.extensions.planning import kept_plans
from linked_fleet_gateway.extensions.planning.kept_plans import KeptPlans, Plan, body_digest
from redis_servers import single

BASE = "http://one.example"
TARGETS = "[] lf:target [ lf:ofJoint <{base}/r/a> ; lf:value {a} ] , [ lf:ofJoint <{base}/r/b> ; lf:value 2 ] {more} ."


def digest(text: str, base: str = BASE) -> str:
    prefix = "@prefix lf: <https://w3id.org/linked-fleet#> . "
    triples = [
        Triple(q.subject, q.predicate, q.object)  # type: ignore[arg-type]
        for q in parse(prefix + text, format=RdfFormat.TURTLE, base_iri=f"{base}/r/actions/moveJoints")
    ]
    objects = {each.object for each in triples}
    return body_digest(Body(triples, next(each.subject for each in triples if each.subject not in objects)), base)  # type: ignore[arg-type]


def said(a: float = 1, more: str = "", base: str = BASE) -> str:
    return TARGETS.format(a=a, more=more, base=base)


def test_the_same_request_has_the_same_fingerprint() -> None:
    other = "[] lf:target [ lf:value 2 ; lf:ofJoint </r/b> ] , [ lf:value 1 ; lf:ofJoint </r/a> ] ; a lf:JointTargets ."
    assert digest(said()) == digest(other) == digest(said(more='; lf:plan "x"'))
    assert digest(said()) == digest(said(base="http://two.example"), "http://two.example"), "at another public URL"


@pytest.mark.parametrize("other", [said(a=3), said(more="; lf:speedScale 0.5"), said(more="; lf:path lf:Planned")])
def test_another_request_has_another_fingerprint(other: str) -> None:
    assert digest(said()) != digest(other)


def test_hostile_bodies_are_read_in_no_time() -> None:
    """A long chain of blank nodes, and nodes that lead to each other in many ways."""
    follows = NamedNode("http://x.example/next")
    nodes = [BlankNode() for _ in range(2_000)]
    chain = [Triple(one, follows, other) for one, other in itertools.pairwise(nodes)]
    layers = [[BlankNode() for _ in range(20)] for _ in range(10)]
    dense = [
        Triple(one, follows, other) for layer, below in itertools.pairwise(layers) for one in layer for other in below
    ]
    for triples in (chain, [*chain, Triple(nodes[-1], follows, nodes[0])], dense):
        assert len(body_digest(Body(triples, triples[0].subject), BASE)) == 32  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def redis(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder: Path = tmp_path_factory.mktemp("redis")
    with single(folder) as servers:
        yield servers.url


def plan(client: str = "one", rows: int = 2) -> Plan:
    follow = Follow(("a",), tuple(float(k + 1) for k in range(rows)), ((0.5,),) * rows)
    at = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    return Plan(client, "digest", follow, {"a": 0.5}, {"a": 0.0}, at, 1.0, {}, {"pathDeviation": 1e-4}, "because")


async def test_another_gateway_finds_a_plan(redis: str) -> None:
    here, there = KeptPlans(redis, "found"), KeptPlans(redis, "found")
    kept = await here.keep(plan())
    assert kept is not None
    found = await there.find(kept.id)
    assert found is not None and found.plan == plan() and 0 < found.left_s <= kept_plans.KEPT_S
    assert await there.find("other") is None
    await here.close()
    await there.close()


async def test_there_is_room_for_some(redis: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The oldest plan of a client makes room for its latest one; clients do not displace each other's."""
    monkeypatch.setattr(kept_plans, "MOST_PLANS", kept_plans.MOST_OF_ONE + 1)
    plans = KeptPlans(redis, "room")
    own = [await plans.keep(plan()) for _ in range(kept_plans.MOST_OF_ONE + 2)]
    found = [each is not None and await plans.find(each.id) is not None for each in own]
    assert found == [False, False, *[True] * kept_plans.MOST_OF_ONE]
    assert await plans.keep(plan("two")) is not None
    assert await plans.keep(plan("three")) is None
    assert await plans.keep(plan(rows=60_000)) is None, "it is too large"
    await plans.close()


async def test_a_plan_is_forgotten(redis: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_plans, "KEPT_S", 0)
    plans = KeptPlans(redis, "forgotten")
    kept = await plans.keep(plan())
    assert kept is not None and await plans.find(kept.id) is None
    await plans.close()
