"""One resource of every kind that has a blueprint, described in this process without robots, Redis or HTTP."""

from dataclasses import replace

from pyoxigraph import NamedNode, Triple

from floor_maps import FREE, UNKNOWN, WALL, pgm, yaml
from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Camera, Description
from linked_fleet_gateway.extensions.cameras.resources import cameras_branch
from linked_fleet_gateway.extensions.history.listing import list_branch
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.resources import RecordedHistory
from linked_fleet_gateway.extensions.history.resources import history_branches as histories
from linked_fleet_gateway.extensions.history.span import Span
from linked_fleet_gateway.extensions.models.resources import BRANCHES as MODELS
from linked_fleet_gateway.extensions.pages.branches import ASSETS
from linked_fleet_gateway.extensions.rules.description import branch as rules_branch
from linked_fleet_gateway.extensions.rules.rule import Firing, FiringState, Rule, RuleRecord
from linked_fleet_gateway.extensions.things.directory import branches as things
from linked_fleet_gateway.extensions.world.collisions import Collision
from linked_fleet_gateway.extensions.world.floor_map import ID as MAP_ID
from linked_fleet_gateway.extensions.world.floor_map import FloorMap
from linked_fleet_gateway.extensions.world.map_image import build_map
from linked_fleet_gateway.extensions.world.map_yaml import read_yaml
from linked_fleet_gateway.extensions.world.placement import LF, WORLD
from linked_fleet_gateway.extensions.world.resources import resolve_world
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, SceneObject, Sphere, TriangleMesh
from linked_fleet_gateway.resources.branches import NO_BRANCHES, FleetBranch
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Kind, Record, Subscription
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import HYBRIT
from linked_fleet_state.events import Appeared, Described, DescriptionRejected
from linked_fleet_state.fleet import DESCRIPTION_WAIT_NS, Fleet
from linked_fleet_state.invocation import FLEET, Invocation, InvocationState, Lease
from linked_fleet_state.invocations import Invocations
from linked_fleet_state.model import Pose

BASE = "http://example.org"
_NOW_NS = 1_700_000_000_000_000_000
_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_MOVING = ("revolute_joint", "continuous_joint", "prismatic_joint")
_CAMERA = Camera(
    name="eye", link="fixed_link", width=4, height=3, vertical_fov_rad=1.0, near_m=0.1, far_m=9.0,
    formats=("jpeg", "png", "depth"),
)  # fmt: skip


def _joint(kind: str, parent: str) -> str:
    limit = '<limit lower="-1" upper="1" effort="5" velocity="2"/>' if kind in ("revolute", "prismatic") else ""
    ends = f'<parent link="{parent}"/><child link="{kind}_link"/><axis xyz="0 0 1"/>'
    return f'<link name="{kind}_link"/><joint name="{kind}_joint" type="{kind}">{ends}{limit}</joint>'


def _urdf(*kinds: str) -> str:
    parents = ("base", *(f"{kind}_link" for kind in kinds))
    chain = "".join(_joint(kind, parent) for kind, parent in zip(kinds, parents, strict=False))
    finger = (
        '<link name="finger_link"/><joint name="finger_joint" type="revolute"><parent link="base"/>'
        '<child link="finger_link"/><mimic joint="revolute_joint" multiplier="2"/>'
        '<limit lower="-1" upper="1" effort="5" velocity="2"/></joint>'
    )
    return f'<robot name="r"><link name="base"/>{chain}{finger}</robot>'


def _described(name: str, base: str) -> Description:
    return Description(
        version=WIRE_VERSION, robot=name, incarnation=1, title=f"The {name}", urdf=_urdf(*_KINDS), joints=_MOVING,
        base=base, rate_hz=50, layout=layout(len(_MOVING), base == "floating"), cameras=(_CAMERA,),
        capabilities=("move", "follow", "stop"),
    )  # fmt: skip


def _fleet() -> Fleet:
    fleet = Fleet()
    for name, base in (("fixed", "fixed"), ("floating", "floating")):
        for event in (Appeared(name, 1), Described(_described(name, base))):
            fleet.apply(event, _NOW_NS)
    fleet.apply(Appeared("faulty", 1), _NOW_NS)
    fleet.apply(DescriptionRejected("faulty", 1, "it cannot be read"), _NOW_NS)
    fleet.apply(Appeared("mute", 1), _NOW_NS)
    fleet.show_awaited(_NOW_NS + DESCRIPTION_WAIT_NS)
    fleet.control("floating", Lease("l1", "floating", "somebody", _NOW_NS, _NOW_NS + 60_000_000_000, 60.0))
    return fleet


def _invocations() -> Invocations:
    found = Invocations()
    turn = Invocation(
        "i1", "fixed", "/fixed/revolute_joint/actions/rotate", {"revolute_joint": 0.5}, _NOW_NS, _NOW_NS + 1,
        duration_s=1.0, started_ns=_NOW_NS, state=InvocationState.RUNNING, incarnation=1, client="somebody",
    )  # fmt: skip
    found.add(turn)
    found.add(
        replace(turn, id="i2", state=InvocationState.FAILED, reason="blocked", ended_ns=_NOW_NS, preempts=("i1",))
    )
    found.add(Invocation("i3", FLEET, "/actions/stopAll", {}, _NOW_NS, _NOW_NS + 1, robots={"fixed": "accepted"}))
    return found


def _record(id: str, kind: Kind, state: DeliveryState) -> Record:
    callback = "https://receiver.example/" if kind is Kind.CALLBACK else ""
    what = Subscription(
        id, "/fixed/", "/fixed/jointState", kind, "text/turtle", BASE, "somebody", _NOW_NS, callback=callback
    )
    return Record(what, Delivery(state), "here")


def _objects() -> dict[str, SceneObject]:
    pose = Pose((1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    shapes = (Box((1.0, 1.0, 1.0)), Sphere(1.0), Cylinder(1.0, 2.0), TriangleMesh(b""))
    return {
        f"o{index}": SceneObject(
            title=f"object {index}", kind="zone" if index else "obstacle", pose=pose, geometry=each
        )
        for index, each in enumerate(shapes)
    }


def _rules() -> dict[str, RuleRecord]:
    firing = Firing(_NOW_NS, {"value": '"1"'}, FiringState.ACCEPTED, reason="why")
    by_name = Rule("u1", "Rule", "SELECT ?a WHERE { ?a ?b ?c }", "/actions/stopAll", BASE, "somebody", _NOW_NS)
    by_variable = replace(by_name, id="u2", invokes="?a", body='_:body <http://example.com/p> "1" .\n', enabled=False)
    return {"u1": RuleRecord(by_name, 1, {1: firing}, begun=True), "u2": RuleRecord(by_variable, 1)}


def _collisions() -> dict[str, Collision]:
    things, names = ("/fixed/fixed_link", "/fixed/base"), ("fixed_link of fixed", "its own base")
    met = Collision(
        "fixed", things, names, (1.0, 0.5, 0.25), "fixed_link would meet base.", "fixed_link would meet base.", 1
    )
    return {"fixed": met}


def _maps() -> dict[str, FloorMap]:
    settings, _ = read_yaml(yaml(0.5))
    image = pgm([[WALL, FREE, UNKNOWN]])
    return {MAP_ID: build_map(settings, image, title="hall", height_m=2.0, client="ann", now_ns=1)}


def tree() -> Tree:
    """Return a tree with the same resources at each call."""
    fleet, rules, objects, maps = _fleet(), _rules(), _objects(), _maps()
    subscriptions = {
        "/fixed/": [
            _record("s1", Kind.CALLBACK, DeliveryState.FAILING),
            _record("s2", Kind.STREAM, DeliveryState.WAITING),
            _record("s3", Kind.WEBSOCKET, DeliveryState.ACTIVE),
            _record("s4", Kind.EVENT_STREAM, DeliveryState.ACTIVE),
        ]
    }
    branches = NO_BRANCHES.with_branches(
        *things(),
        *MODELS,
        rules_branch(rules),
        FleetBranch(WORLD[1:], LF.world, lambda view, rest: resolve_world(view, rest, objects, _collisions(), maps)),
        *histories(recorded := History(fleet, 60.0, 10.0, 1_000_000), None),
        list_branch(recorded),
        cameras_branch(lambda robot, camera: {}),
        ASSETS,
    )
    return Tree(fleet, _invocations(), BASE, subscriptions, branches=branches)


def described(tree: Tree, path: str) -> list[Triple]:
    """Return the description of the resource at ``path``; a resource that depends on a query gets none."""
    found = tree.resolve(path)
    assert isinstance(found, Resource), path
    if isinstance(found.remote, RecordedHistory):
        found = found.remote.select_page(Span()).resource
    assert found.describe is not None, path
    graph = Graph()
    found.describe(graph)
    return graph.triples


def blueprint_path(triples: list[Triple], path: str) -> str | None:
    """Return the path of the blueprint that a description links, if any."""
    found = [
        t.object.value.removeprefix(BASE)
        for t in triples
        if t.subject == NamedNode(BASE + path) and t.predicate == HYBRIT.blueprint and BASE in t.object.value
    ]
    assert len(found) <= 1, found
    return found[0] if found else None


def described_paths(tree: Tree) -> list[str]:
    """Return the paths of the resources that have a description and can be reached from the root."""
    found_here, known, pending = [], {"/"}, ["/"]
    while pending:
        path = pending.pop()
        found = tree.resolve(path)
        if not isinstance(found, Resource) or (
            found.describe is None and not isinstance(found.remote, RecordedHistory)
        ):
            continue
        found_here.append(path)
        triples = described(tree, path)
        named = {term.value for t in triples for term in t if isinstance(term, NamedNode)}
        named |= {BASE + each for each in (*found.own_paths, *found.part_paths)}
        for iri in sorted(named):
            target = iri.removeprefix(BASE).partition("#")[0]
            if iri.startswith(BASE + "/") and "?" not in iri and target not in known:
                known.add(target)
                pending.append(target)
    return sorted(found_here)
