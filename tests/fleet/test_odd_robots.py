"""Robots with wrong or odd descriptions: only they are faulty, reachable by links, and conform to their blueprints."""

import math
import random
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh
from rdflib import RDF, URIRef

from browser import DCTERMS, HYBRIT, LDP, LF, ROS, SPATIAL, Browser
from fake_robots import FakeRobot, joint, link, open_session, robot
from running import Process, eventually
from small_fleet import Place, faulty, live, move, number, presence, property_page, whole
from walk import Visited

pytestmark = pytest.mark.virtual


@pytest.fixture
def observed_fleet(tmp_path: Path) -> Iterator[tuple[Process, Browser, zenoh.Session]]:
    """Yield a gateway without robots but those played by the test."""
    place = Place(tmp_path)
    with ExitStack() as stack:
        gateway, browser = stack.enter_context(place.gateway())
        yield gateway, browser, stack.enter_context(open_session(place.zenoh))


ObservedFleet = tuple[Process, Browser, zenoh.Session]


def test_faulty_descriptions_harm_nobody_else(observed_fleet: ObservedFleet) -> None:
    """Unparsable URDF, a foreign version, no JSON, another's name: faulty with the reason; the valid one is live."""
    gateway, browser, session = observed_fleet
    good = FakeRobot(session, "good").appear().stand(0.25)
    cases = {
        "broken-urdf": (lambda actor: actor.description(urdf="<robot><link"), "XML"),
        "no-tree": (lambda actor: actor.description(urdf=robot(link("a"), link("b")), joints=()), "single tree"),
        "stranger": (lambda actor: actor.description(joints=("knee",)), "knee"),
        "foreign": (lambda actor: actor.description(version=99), "version 99"),
        "no-json": (lambda actor: b"\xff\x00", ""),
        "impostor": (lambda actor: good.description(), "'good'"),
    }
    actors = [FakeRobot(session, name) for name in cases]
    for actor in actors:
        actor.appear(cases[actor.name][0](actor))
    live(browser, "good")
    for name, (_, named) in cases.items():
        assert named.lower() in eventually(lambda name=name: faulty(browser, name), name).lower()
    whole(browser)
    assert number(property_page(browser, "good", "elbow", ROS.rotation), SPATIAL.rotationAngle) == 0.25
    assert presence(browser, "good").graph.value(None, LF.fault) is None
    assert "Traceback" not in gateway.output


def test_faulty_robot_recovers_with_a_new_run(observed_fleet: ObservedFleet) -> None:
    """A restart with a description that can be used ends the fault."""
    _, browser, session = observed_fleet
    broken = FakeRobot(session, "r")
    broken.appear(broken.description(urdf="<robot/>"))
    assert "link" in faulty(browser, "r")
    FakeRobot(session, "r").appear().stand(0.5)
    page = live(browser, "r")
    assert (page.iri, LF.fault, None) not in page.graph


def test_names_that_need_an_escape(observed_fleet: ObservedFleet) -> None:
    """Joint and link with the same name, joints and robots named like sub-resources: links reach all."""
    _, browser, session = observed_fleet
    others = ("health", "ä", "subscriptions")
    for name in others:
        FakeRobot(session, name).appear().stand(0.0)
    odd = ("subscriptions", "actions", "jointState", "arm", "ä/~")
    urdf = robot(
        link("base"),
        *(link(each) for each in odd),
        *(joint(each, "revolute", parent, each) for parent, each in zip(("base", *odd), odd, strict=False)),
    )
    actor = FakeRobot(session, "a/b")
    actor.appear(actor.description(urdf, odd)).stand(*(0.1 * index for index in range(5)))
    robots = {name: live(browser, name) for name in (*others, "a/b")}
    tree = whole(browser)

    def titled(kind: str, robot: str) -> dict[str, Visited]:
        pages = [page for page in tree.of(kind) if page.url.startswith(robots[robot].url)]
        by_title = {str(page.graph.value(page.iri, DCTERMS.title)): page for page in pages}
        assert len(by_title) == len(pages)
        return by_title

    joints = titled("joint", "a/b")
    assert joints.keys() == {*odd}
    assert titled("link", "a/b").keys() == {"base", *odd}
    for name, page in robots.items():
        assert str(page.graph.value(page.iri, DCTERMS.identifier)) == name
        assert name == "a/b" or titled("joint", name).keys() == {"elbow"}
    for index, each in enumerate(odd):
        joint_page = joints[each]
        rotation = browser.page(str(joint_page.graph.value(joint_page.iri, ROS.rotation)))
        assert number(rotation, SPATIAL.rotationAngle) == pytest.approx(0.1 * index)
        action = str(joint_page.graph.value(joint_page.iri, HYBRIT.action))
        assert browser.http.options(action).headers["accept-put"]


def test_every_kind_of_joint(observed_fleet: ObservedFleet) -> None:
    """Also joints without transmitted values; unknown values are lf:unknown."""
    gateway, browser, session = observed_fleet
    kinds = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")
    urdf = robot(
        link("base"),
        *(link(f"{kind}_link", inertial=kind != "planar") for kind in kinds),
        link("follower_link"),
        *(
            joint(kind, kind, parent, f"{kind}_link")
            for parent, kind in zip(("base", *(f"{kind}_link" for kind in kinds)), kinds, strict=False)
        ),
        joint("follower", "revolute", "base", "follower_link", '<mimic joint="revolute" multiplier="-1"/>'),
    )
    movable = ("revolute", "continuous", "prismatic", "follower")
    actor = FakeRobot(session, "r")
    actor.appear(actor.description(urdf, movable)).stand(0.1, 4.0, 0.2, -0.1)
    live(browser, "r")
    tree = whole(browser)
    assert len(tree.of("joint")) == 7
    assert browser.part("r", "follower").graph.value(browser.part("r", "follower").iri, HYBRIT.action) is None
    for kind in ("floating", "planar"):
        pose = property_page(browser, "r", kind, LF.pose)
        assert LF.unknown in set(pose.graph.objects())
    assert LF.unknown not in set(property_page(browser, "r", "prismatic_link", LF.pose).graph.objects())
    for below in ("floating_link", "planar_link"):
        assert LF.unknown in set(property_page(browser, "r", below, LF.pose).graph.objects())
    assert number(property_page(browser, "r", "planar_link", LF.mass), LF.value) == LF.unknown
    assert number(property_page(browser, "r", "follower", ROS.friction), LF.value) == LF.unknown
    assert "Traceback" not in gateway.output


@pytest.mark.parametrize("floating", [False, True])
def test_before_the_first_frame_and_with_nan(observed_fleet: ObservedFleet, floating: bool) -> None:
    """Every value is lf:unknown, nothing else is missing, and actions get 503; NaN in a frame is lf:unknown."""
    _, browser, session = observed_fleet
    actor = FakeRobot(session, "r")
    actor.appear(actor.description(floating=floating))
    eventually(lambda: (page := presence(browser, "r")) and (page.iri, LF.rootLink, None) in page.graph, "described")
    whole(browser)
    page = browser.robot("r")
    assert page.one(LF.lastFrame) == LF.unknown
    assert number(property_page(browser, "r", "elbow", ROS.rotation), SPATIAL.rotationAngle) == LF.unknown
    for kind in (LF.velocity, LF.effort):
        assert number(property_page(browser, "r", "elbow", kind), LF.value) == LF.unknown
    assert LF.unknown in set(property_page(browser, "r", "tip", LF.pose).graph.objects())
    action = browser.action(browser.part("r", "elbow"), LF.Rotate)
    assert move(browser, action, 0.1).status_code == 503
    if not floating:
        actor.stand(math.nan)
        live(browser, "r")
        whole(browser)
        assert number(property_page(browser, "r", "elbow", ROS.rotation), SPATIAL.rotationAngle) == LF.unknown
        assert LF.unknown in set(property_page(browser, "r", "tip", LF.pose).graph.objects())


def test_actor_that_never_described_itself_is_forgotten_when_it_leaves(observed_fleet: ObservedFleet) -> None:
    """It only had a token: the fleet lists it while it is present, and conforms."""
    _, browser, session = observed_fleet
    token = session.liveliness().declare_token("fleet/robot/r/presence/1")
    eventually(lambda: presence(browser, "r"), "r")
    whole(browser)
    token.undeclare()
    eventually(lambda: presence(browser, "r") is None, "r forgotten")
    whole(browser)


_PREFIXES = """@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix dcterms: <http://purl.org/dc/terms/> .
@prefix lf: <https://w3id.org/linked-fleet#> . @prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> .
@prefix ros: <http://ros.org/#> . @prefix ex: <http://example.org/> .
@prefix xhv: <http://www.w3.org/1999/xhtml/vocab#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
"""


def test_annotations_cannot_pose_as_the_gateway(observed_fleet: ObservedFleet) -> None:
    """They cannot override statements of the gateway; the rest is shown; invalid Turtle is left out."""
    _, browser, session = observed_fleet
    said = """
    <> ex:colour "red" ; ex:maker [ ex:name "ACME" ; lf:fault "inner" ] ; lf:presence lf:offline ; lf:fault "none" ;
       hybrit:action ex:fly ; a lf:Fleet, hybrit:Action, ex:Toy ; dcterms:title "Other" ; dcterms:identifier "other" ;
       dcterms:hasPart ex:wing ; dcterms:creator "me" .
    <elbow> ros:rotation ex:far ; a ros:Link, ex:Hinge ; hybrit:property ex:far ; xhv:next ex:far ;
       dcterms:title "knee" .
    <tip> a lf:Joint ; lf:mass ex:heavy ; rdfs:comment "a tip" .
    <../good/> ex:colour "blue" .
    """
    actor = FakeRobot(session, "r")
    actor.appear(actor.description(annotations=_PREFIXES + said)).stand(0.1)
    FakeRobot(session, "good").appear().stand(0.1)
    broken = FakeRobot(session, "broken")
    broken.appear(broken.description(annotations="<> <oops")).stand(0.1)
    page = live(browser, "r")
    live(browser, "broken")
    other = live(browser, "good")
    whole(browser)
    example = "http://example.org/"
    assert str(page.graph.value(page.iri, URIRef(example + "colour"))) == "red"
    assert (other.iri, URIRef(example + "colour"), None) not in other.graph
    types = {str(each) for each in page.graph.objects(page.iri, RDF.type)}
    assert types == {str(HYBRIT.RoboticThing), str(LF.Robot), str(LDP.RDFSource), example + "Toy"}
    elbow, tip = browser.part("r", "elbow"), browser.part("r", "tip")
    assert URIRef(example + "Hinge") in elbow.types
    assert ROS.Link not in elbow.types
    assert LF.Joint not in tip.types
    for graph in (page.graph, elbow.graph, tip.graph):
        assert not {example + each for each in ("fly", "far", "heavy", "wing")} & {str(o) for o in graph.objects()}
    assert [str(each) for each in page.graph.objects(page.iri, DCTERMS.title)] == ["The r"]
    assert [str(each) for each in elbow.graph.objects(elbow.iri, DCTERMS.title)] == ["elbow"]
    assert (None, LF.fault, None) not in page.graph


def test_hostile_sizes_of_a_urdf(observed_fleet: ObservedFleet) -> None:
    """Entities and depth: the robot is faulty, and the gateway continues."""
    _, browser, session = observed_fleet
    bomb = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
    for name, urdf in (("bomb", bomb), ("deep", "<a>" * 100_000 + "</a>" * 100_000)):
        actor = FakeRobot(session, name)
        actor.appear(actor.description(urdf=urdf, joints=()))
        assert faulty(browser, name)
    FakeRobot(session, "good").appear(None).stand(0.1)
    live(browser, "good")


def test_malformed_and_foreign_messages_are_harmless(observed_fleet: ObservedFleet) -> None:
    """Whatever is published: the gateway serves, the valid robot keeps its values, one log line per sender."""
    gateway, browser, session = observed_fleet
    good = FakeRobot(session, "good").appear().stand(0.25)
    live(browser, "good")
    frame = good.frame((0.75,))
    noise = random.Random(1).randbytes(200)
    bad = [b"", b"LF", frame[:-1], frame + b"x", noise, b"\0" * 1_000_000, good.frame((0.75, 0.75))]
    bad.append(good.frame((0.75,), incarnation=good.incarnation + 1000))
    keys = [f"fleet/robot/{name}/{kind}" for name in ("good", "nobody") for kind in ("state", "progress")]
    keys += [
        "fleet/robot/a~zz/state",
        "fleet/robot/~41/progress",
        "fleet/robot/x/y/z/state",
        "fleet/other",
        "elsewhere",
    ]
    for _ in range(3):
        for key in keys:
            for payload in bad:
                if (key, payload) != ("fleet/robot/good/state", frame):
                    session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
    tokens = ("good/presence/x", "good/presence/99999999999999999999", "~41/presence/1", "nobody/presence/-1")
    kept = [session.liveliness().declare_token(f"fleet/robot/{token}") for token in tokens]
    for sender in ("'good'", "a~zz", "~41/progress", "~41/presence"):
        gateway.said(sender)
    last = session.liveliness().declare_token("fleet/robot/last/presence/1")
    eventually(lambda: presence(browser, "last"), "what came after all that")
    page = live(browser, "good")
    assert (page.iri, LF.fault, None) not in page.graph
    assert number(property_page(browser, "good", "elbow", ROS.rotation), SPATIAL.rotationAngle) == 0.25
    whole(browser)
    said = re.findall(r"WARNING (\S+): '([^ ]+)' sent", gateway.output)
    assert len(said) == len(set(said)), gateway.output
    assert {str(page.graph.value(page.iri, DCTERMS.identifier)) for page in browser.robots()} == {"good", "last"}
    assert "Traceback" not in gateway.output
    for token in (*kept, last):
        token.undeclare()
