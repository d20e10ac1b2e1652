"""Desideratum D5: binary frames, decoded only by the RDF layout that each response names."""

import math
import struct
from collections.abc import Iterator

import httpx
import pyshacl
import pytest
import rdflib
from rdflib import Namespace
from rdflib.collection import Collection

from browser import HYBRIT, LF, ROS, SOSA, Browser, Page, links
from fake_robots import FakeRobot, open_session
from running import eventually
from small_fleet import Place
from subscribers import ObservedFleet, Socket, observed_fleet

QUDT, UNIT = Namespace("http://qudt.org/schema/qudt/"), Namespace("http://qudt.org/vocab/unit/")
OCTETS, FRAME = "application/octet-stream", "application/vnd.linked-fleet.frame"
pytestmark = pytest.mark.virtual
CODES = {"char2": "2s", "uint16": "H", "uint32": "I", "uint64": "Q", "int64": "q", "float64": "d"}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ObservedFleet]:
    with observed_fleet(Place(tmp_path_factory.mktemp("binary"))) as opened:
        yield opened


def _get(scene: ObservedFleet, url: str, accept: str = OCTETS) -> httpx.Response:
    answer = scene.browser.http.get(url, headers={"accept": accept})
    assert (answer.status_code, answer.headers["content-type"]) == (200, accept)
    return answer


def _layout(scene: ObservedFleet, answer: httpx.Response) -> Page:
    (url,) = links(answer, "describedby")
    return scene.browser.page(url)


def _decoded(layout: Page, body: bytes) -> dict[str, object]:
    """Return the values by field name; the layout covers every byte exactly once."""
    graph, found, covered = layout.graph, {}, []
    for field in graph.objects(layout.iri, LF.field):
        code, offset = "<" + CODES[str(graph.value(field, LF.fieldType))], int(graph.value(field, LF.byteOffset))
        covered += range(offset, offset + struct.calcsize(code))
        (found[str(graph.value(field, LF.fieldName))],) = struct.unpack_from(code, body, offset)
    assert sorted(covered) == list(range(len(body))) == list(range(int(layout.one(LF.byteSize))))
    return found


def test_a_value_has_the_version_and_the_time_of_its_rdf(scene: ObservedFleet) -> None:
    """Version, time, number and unit of a frame are those of the message in Turtle; NaN where that says unknown."""
    with (
        scene.toy(0.25) as toy,
        Socket(toy.rotation()) as in_turtle,
        Socket(toy.rotation(), accept=OCTETS) as in_octets,
    ):
        for angle in (0.25, 0.5):
            toy.pose(angle)
            said, body = in_turtle.next(), in_octets.raw()
            assert isinstance(body, bytes)
            value = _decoded(_layout(scene, _get(scene, toy.rotation())), body)
            assert (value["magic"], value["version"], value["rotation"]) == (b"LV", 1, angle)
            change = f".{value['change']}" if value["change"] else ""
            assert said.version == f"{value['incarnation']}-{value['frame']}{change}"
        stamp = said.graph.value(said.iri, SOSA.resultTime)
        assert stamp.toPython().timestamp() == pytest.approx(int(str(value["time"])) / 1e9, abs=1e-3)
        velocity = str(toy.part().one(LF.velocity))
        unknown = _decoded(_layout(scene, _get(scene, velocity)), _get(scene, velocity).content)
        assert math.isnan(float(str(unknown["velocity"])))
        assert _get(scene, velocity, FRAME).content == _get(scene, velocity).content


def test_every_number_leads_to_its_property_and_back(scene: ObservedFleet) -> None:
    """The path of each number, followed in the description of its property, leads to that number and its unit."""
    with scene.toy(0.25, -0.5) as toy:
        state = str(toy.page.one(LF.jointState))
        pose = str(toy.part("tip").one(LF.pose))
        for url, count in ((state, 6), (toy.rotation(), 1), (pose, 7)):
            answer = _get(scene, url)
            layout = _layout(scene, answer)
            numbers = list(layout.graph.subjects(LF.ofProperty))
            assert len(numbers) == count
            values = _decoded(layout, answer.content)
            for field in numbers:
                here, graph = layout.graph, scene.browser.page(str(layout.graph.value(field, LF.ofProperty))).graph
                node, above = here.value(field, LF.ofProperty), None
                for step in Collection(here, here.value(field, LF.valuePath)):
                    node, above = graph.value(node, step), node
                unit = graph.value(above, QUDT.unit) or UNIT.UNITLESS
                assert here.value(field, QUDT.unit) == unit
                value = float(str(values[str(here.value(field, LF.fieldName))]))
                assert node == LF.unknown if math.isnan(value) else float(str(node)) == pytest.approx(value, abs=1e-5)


def test_before_the_first_frame_nothing_is_invented(scene: ObservedFleet) -> None:
    """A robot that has only sent its description: no frame of its state, NaN and no time for a value."""
    with open_session(scene.place.zenoh) as session:
        actor = FakeRobot(session, "silent").appear()
        part = eventually(lambda: _part(scene.browser, actor.name), "the joint of the silent robot")
        rotation, state = str(part.one(ROS.rotation)), str(scene.browser.robot(actor.name).one(LF.jointState))
        answer = _get(scene, rotation)
        value = _decoded(_layout(scene, answer), answer.content)
        assert (math.isnan(float(str(value["rotation"]))), value["time"], value["frame"]) == (True, -1, 0)
        assert scene.browser.http.get(state, headers={"accept": OCTETS}).status_code == 406
        with Socket(state, accept=OCTETS) as socket:
            frame = actor.frame((0.5,))
            actor.put("state", frame)
            assert socket.raw() == frame


def _part(browser: Browser, name: str) -> Page | None:
    try:
        return browser.part(name, "elbow")
    except AssertionError:
        return None


def test_layouts_conform_to_their_blueprints(scene: ObservedFleet) -> None:
    """Of a whole state and of one value; without the type of a field or the unit of a number they do not."""
    with scene.toy() as toy:
        for url in (str(toy.page.one(LF.jointState)), toy.rotation()):
            layout = _layout(scene, _get(scene, url))
            (blueprint,) = (each for each in layout.graph.objects(layout.iri, HYBRIT.blueprint) if scene.root in each)
            shapes = scene.browser.page(str(blueprint)).graph
            assert pyshacl.validate(layout.graph, shacl_graph=shapes)[0]
            number = next(layout.graph.subjects(LF.ofProperty))
            for predicate in (LF.fieldType, LF.byteOffset, QUDT.unit, LF.valuePath):
                less = rdflib.Graph()
                less += layout.graph
                less.remove((number, predicate, None))
                assert not pyshacl.validate(less, shacl_graph=shapes)[0], predicate


def test_resources_without_measured_values_have_no_frames(scene: ObservedFleet) -> None:
    """Constants and things have neither frames nor a layout, and say so."""
    with scene.toy() as toy:
        limits = str(toy.part().one(LF.limits))
        for url in (limits, toy.part().url, toy.page.url):
            assert scene.browser.http.get(url, headers={"accept": OCTETS}).status_code == 406
        assert scene.browser.http.get(limits + "/layout").status_code == 404
        assert not links(scene.browser.http.get(limits), "describedby")
