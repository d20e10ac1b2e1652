"""Components over HTTP: their descriptions, values, events and actions, with the agent of a real driver."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

import httpx
import pyshacl
import pytest
import rdflib
from rdflib import RDF, RDFS, Literal, URIRef

from browser import DCTERMS, HYBRIT, LF, SH, SOSA, VOM, Browser, Page
from component_cell import Cell, Colour, Grasped, Piece
from linked_fleet_agent.components import Battery, Call, Charge, Component, PowerSupplyState, action, unit, value
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_client.errors import InvalidInput
from linked_fleet_client.fleet import Fleet
from linked_fleet_gateway.extensions.components import declarations
from linked_fleet_gateway.http.scheduling import SHORT_BYTES, Offload
from linked_fleet_rdf.validation import ShaclValidator
from running import eventually
from small_fleet import Place, number, whole
from subscribers import Events, events
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
JSON = {"content-type": "application/json", "accept": "application/json"}
DONE = {**JSON, "prefer": "return=representation, wait=5"}


@dataclass
class Hall:
    browser: Browser
    cell: Cell
    place: Place

    @property
    def root(self) -> str:
        return self.place.root + "cell/"

    def json(self, path: str) -> Any:
        return self.browser.http.get(self.root + path, headers=JSON).raise_for_status().json()

    def page(self, path: str) -> Page:
        return self.browser.page(self.root + path)

    def invoke(self, path: str, body: Any = None, **headers: str) -> httpx.Response:
        return self.browser.http.post(f"{self.root}{path}", json={} if body is None else body, headers=DONE | headers)

    def until(self, path: str, member: str, wanted: Any) -> None:
        eventually(lambda: self.json(path)[member] == wanted, f"{path} is {wanted}")


@pytest.fixture
def hall(tmp_path: Any) -> Iterator[Hall]:
    place, cell = Place(tmp_path), Cell()
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "cell", cell):
        found = Hall(browser, cell, place)
        eventually(lambda: browser.http.get(found.root + "lamp").status_code == 200, "components")
        found.until("lamp", "count", 3)
        yield found


def test_a_robot_leads_to_its_components_and_each_conforms_to_its_blueprint(hall: Hall) -> None:
    robot, gripper = hall.page(""), hall.page("gripper")
    parts = set(robot.graph.objects(robot.iri, DCTERMS.hasPart))
    assert {gripper.iri, URIRef(hall.root + "lamp"), URIRef(hall.root + "slide")} <= parts
    assert (gripper.iri, RDF.type, LF.Component) in gripper.graph
    assert gripper.one(DCTERMS.isPartOf) == robot.iri
    assert str(gripper.one(RDFS.comment)) == "Two fingers."
    for path in (
        "gripper",
        "lamp",
        "gripper/width",
        "lamp/on",
        "lamp/colour",
        "lamp/pieces",
        "lamp/count",
        "gripper/lost",
    ):
        page, blueprint = hall.page(path), hall.page(f"{path}/blueprint")
        conforms, _, text = pyshacl.validate(page.graph, shacl_graph=blueprint.graph)
        assert conforms, f"{path}: {text}"
        assert list(blueprint.graph.objects(None, SH.targetNode)) == [page.iri]


def test_all_that_links_lead_to_is_there_and_conforms(hall: Hall) -> None:
    assert {hall.root + "gripper", hall.root + "lamp/on"} <= whole(hall.browser).pages.keys()


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        (b'{"width": ' + b"[" * 900 + b"]" * 900 + b"}", 400, "nested more than 16 deep"),
        (b'{"width": ' + b'{"a": ' * 500 + b"1" + b"}" * 501, 400, "nested more than 16 deep"),
        (b'{"width": [' + b",".join([b"1"] * 20_000) + b"]}", 400, "more than 10000 commas"),
        (b'{"width": [[[[1]]]]}', 422, "width"),
        (b'{"width": 0.01, "width": 0.02}', 400, "two members of the same name"),
        (b'{"width": "\xff"}', 400, "not UTF-8"),
    ],
)
def test_inputs_that_would_cost_much_are_refused(hall: Hall, body: bytes, status: int, said: str) -> None:
    answer = hall.browser.http.post(hall.root + "gripper/actions/grasp", content=body, headers=JSON)
    assert (answer.status_code, said in answer.json()["detail"]) == (status, True), answer.text[:300]


def test_values_of_every_type_are_in_json_and_in_rdf(hall: Hall) -> None:
    hall.cell.lamp.shelf = [Piece("nut", 0.5), Piece("bolt", 0.25)]
    hall.until("lamp/pieces", "value", [{"label": "nut", "size": 0.5}, {"label": "bolt", "size": 0.25}])
    assert hall.json("lamp") == {"on": False, "colour": "red", "pieces": hall.json("lamp/pieces")["value"], "count": 3}
    assert hall.json("gripper/width") | {"resultTime": ""} == {"value": 0.08, "unit": "M", "resultTime": ""}
    width = hall.page("gripper/width")
    assert number(width, LF.value) == pytest.approx(0.08)
    assert _value(hall.page("lamp/colour")) == Literal("red")
    assert _value(hall.page("lamp/on")) == Literal(False)
    pieces = hall.page("lamp/pieces")
    labels = rdflib.collection.Collection(pieces.graph, _value(pieces))
    label = URIRef(hall.root + "vocabulary#lamp-property-pieces-label")
    assert [str(pieces.graph.value(each, label)) for each in labels] == ["nut", "bolt"]
    assert str(hall.page("vocabulary").graph.value(label, RDFS.label)) == "label"


def _value(page: Page) -> Any:
    return page.graph.value(page.iri, LF.value)


def test_a_value_that_cannot_be_read_is_unknown_with_the_reason(hall: Hall) -> None:
    hall.cell.gripper.broken = "no bus"
    hall.until("gripper", "width", None)
    assert number(hall.page("gripper/width"), LF.value) == LF.unknown
    assert str(hall.page("gripper").one(LF.fault)) == "width cannot be read: no bus"
    hall.cell.gripper.broken = ""
    hall.until("gripper", "width", 0.08)
    assert hall.page("gripper").graph.value(hall.page("gripper").iri, LF.fault) is None


def test_the_shape_of_an_input_is_compiled_once_and_off_the_event_loop(
    hall: Hall, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also for a short body: a robot declares shapes that take tens of milliseconds."""
    compiled, in_thread, run = list[bool](), list[bool](), Offload.run

    def compile_it(*arguments: Any) -> ShaclValidator:
        compiled.append(in_thread[-1])
        return ShaclValidator(*arguments)

    def offload(self: Offload, work: Any, size: int, *more: int) -> Any:
        in_thread.append(size > (more or (SHORT_BYTES,))[0])
        return run(self, work, size, *more)

    monkeypatch.setattr(declarations, "ShaclValidator", compile_it)
    monkeypatch.setattr(Offload, "run", offload)
    for force in (20, 21):
        assert hall.invoke("gripper/actions/grasp", {"force": force}).status_code == 201
    for on in (True, False):
        assert hall.browser.http.put(hall.root + "lamp/on", json={"value": on}).status_code == 204
    assert compiled == [True, True]
    assert not in_thread[-1], "what is compiled takes a short body on the event loop"


def test_an_action_has_feedback_and_a_result(hall: Hall) -> None:
    answer = hall.invoke("gripper/actions/grasp", {"force": 20})
    assert answer.status_code == 201, answer.text
    said = answer.json()
    assert (said["state"], said["output"]) == (str(LF.succeeded), {"width": 0.03, "holding": True})
    assert said["feedback"] == pytest.approx(0.03)
    hall.until("gripper", "width", 0.03)
    page = hall.browser.page(answer.headers["location"])
    terms = rdflib.Namespace(hall.root + "vocabulary#")
    output = page.graph.value(page.iri, LF.output)
    assert page.graph.value(output, terms["gripper-result-grasp-holding"]) == Literal(True)
    width = page.graph.value(output, terms["gripper-result-grasp-width"])
    assert float(page.graph.value(width, VOM.numericalValue)) == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("path", "body", "status", "said"),
    [
        ("gripper/actions/grasp", {"force": 71}, 422, "must be at most 70"),
        ("gripper/actions/grasp", {"width": -0.01}, 422, "must be"),
        ("gripper/actions/grasp", {"forc": 1}, 422, "forc is not known; there are width, force"),
        ("gripper/actions/grasp", {"force": "much"}, 422, "force"),
        ("gripper/actions/grasp", [1], 422, "is a JSON object"),
        ("lamp/actions/paint", {}, 422, "colour"),
        ("lamp/actions/paint", {"colour": "blue"}, 422, "blue"),
        ("lamp/actions/on", {"value": 3}, 422, "xsd:boolean"),
        ("lamp/actions/on", {"on": True}, 422, "on is not known; there are value"),
        ("lamp/actions/on", {}, 422, "one member: value"),
        ("lamp/actions/none", {}, 404, ""),
        ("lamp/actions/colour", {"value": "red"}, 404, ""),
    ],
)
def test_what_violates_the_shape_is_refused_with_a_sentence(
    hall: Hall, path: str, body: Any, status: int, said: str
) -> None:
    answer = hall.invoke(path, body)
    assert (answer.status_code, said in answer.json()["detail"]) == (status, True), answer.text
    assert not hall.cell.lamp.lit and hall.cell.gripper.gap == 0.08


NOTHING = {
    "text/turtle": b"@prefix lf: <https://w3id.org/linked-fleet#> .",
    "application/n-triples": b"# nothing",
    "application/ld+json": b"{}",
    "application/rdf+xml": b'<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"/>',
    "application/json": b"{}",
}


@pytest.mark.parametrize("media_type", NOTHING)
def test_an_action_whose_inputs_are_all_optional_takes_an_empty_body_in_every_syntax(
    hall: Hall, media_type: str
) -> None:
    action, headers = f"{hall.root}gripper/actions/grasp", {"content-type": media_type, "prefer": "wait=5"}
    for content in (NOTHING[media_type], b"", iter([b""])):
        answer = hall.browser.http.post(action, content=content, headers=headers)
        assert answer.status_code == 204, answer.text
        assert hall.browser.page(answer.headers["location"]).one(LF.state) == LF.succeeded


def test_the_client_invokes_an_action_without_any_of_its_optional_inputs(hall: Hall) -> None:
    with Fleet(hall.place.root) as fleet:
        assert fleet["cell"]["gripper"].actions["grasp"]().wait(timeout_s=5) == "succeeded"


def test_an_action_whose_input_may_be_empty_needs_no_body(hall: Hall) -> None:
    answer = hall.browser.http.post(hall.root + "gripper/actions/grasp", headers={"prefer": "wait=5"})
    assert answer.status_code == 204, answer.text
    assert hall.browser.http.post(hall.root + "lamp/actions/paint").status_code == 415


@pytest.mark.parametrize(
    ("media_type", "body"),
    [
        ("application/json", '{"value": true}'),
        ("text/turtle", "@prefix lf: <https://w3id.org/linked-fleet#> . <> lf:value true ."),
    ],
)
def test_a_property_is_set_by_put(hall: Hall, media_type: str, body: str) -> None:
    url = hall.root + "lamp/on"
    answer = hall.browser.http.put(url, content=body, headers={"content-type": media_type, "prefer": "wait=5"})
    assert answer.status_code == 204, answer.text
    assert hall.cell.lamp.lit
    hall.until("lamp", "on", True)
    read = hall.browser.http.get(url, headers={"accept": "text/turtle"}).text
    again = hall.browser.http.put(url, content=read, headers={"content-type": "text/turtle"})
    assert again.status_code == 204, "what was read can be written"


def test_what_moves_nothing_runs_beside_a_motion_and_a_stop_ends_what_moves(hall: Hall) -> None:
    waiting = hall.invoke("gripper/actions/wait", prefer="respond-async")
    assert waiting.status_code == 202
    assert hall.invoke("lamp/actions/paint", {"colour": "green"}).json()["state"] == str(LF.succeeded)
    assert hall.cell.lamp.hue == Colour.GREEN
    assert hall.browser.http.post(hall.root + "actions/stop").status_code == 204
    eventually(lambda: _state(hall, waiting) == str(LF.cancelled), "the action is cancelled")


def test_of_two_that_move_the_same_the_later_one_preempts_the_earlier(hall: Hall) -> None:
    waiting = hall.invoke("gripper/actions/wait", prefer="respond-async")
    grasped = hall.invoke("gripper/actions/grasp")
    assert grasped.json()["state"] == str(LF.succeeded)
    assert _state(hall, waiting) == str(LF.preempted)


def _state(hall: Hall, answer: httpx.Response) -> str:
    found: str = hall.browser.http.get(answer.headers["location"], headers=JSON).json()["state"]
    return found


def test_a_rehearsal_does_nothing(hall: Hall) -> None:
    answer = hall.invoke("lamp/actions/on", {"value": True}, prefer="dry-run")
    assert answer.status_code == 200, answer.text
    assert not hall.cell.lamp.lit


def test_only_who_has_control_operates(hall: Hall) -> None:
    lease = hall.browser.http.put(hall.root + "lease", json={"holder": "me", "duration": 60}, headers=JSON)
    token = lease.headers["lock-token"]
    assert hall.invoke("gripper/actions/grasp").status_code == 409
    assert hall.invoke("gripper/actions/grasp", **{"lock-token": token}).status_code == 201


def test_a_request_is_carried_out_once_for_each_key(hall: Hall) -> None:
    first, again = (hall.invoke("lamp/actions/paint", {"colour": "green"}, **{"idempotency-key": '"k"'}) for _ in "12")
    assert first.headers["location"] == again.headers["location"]


def test_changes_of_values_and_events_are_told_to_subscribers(hall: Hall) -> None:
    with events(hall.root + "gripper/lost") as told:
        assert _said(told, LF.occurrences) == Literal(0)
        hall.cell.gripper.lost(Grasped(0.01, holding=False))
        assert _said(told, LF.occurrences) == Literal(1)
    assert hall.json("gripper/lost")["value"] == {"width": 0.01, "holding": False}
    with events(hall.root + "lamp/on") as told:
        assert _said(told, LF.value) == Literal(False)
        hall.cell.lamp.lit = True
        assert _said(told, LF.value) == Literal(True)


def _said(told: Events, predicate: URIRef) -> Any:
    message = told.next()
    return message.state.value(message.iri, predicate)


def test_pages_have_values_forms_and_events(hall: Hall) -> None:
    def page(path: str) -> str:
        return hall.browser.http.get(hall.root + path, headers={"accept": "text/html"}).raise_for_status().text

    robot, gripper, grasp = page(""), page("gripper"), page("gripper/actions/grasp")
    assert '<h2 id="parts-title">Components</h2>' in robot and f"{hall.root}gripper" in robot
    for heading in ("Values", "Actions", "Events"):
        assert f">{heading}</h2>" in gripper
    assert 'value="0.08" data-unit="m"' in gripper and "Two fingers." in gripper
    assert 'data-include="' + hall.root + "gripper/actions/grasp" in gripper
    assert "&#34;max&#34;:70.0" in grasp and "Also described here" not in grasp
    assert grasp.count('data-path="http://qudt.org/schema/qudt/unit"') == 0, "a unit is asked for once"
    hall.cell.gripper.broken = "no bus"
    eventually(lambda: "width cannot be read: no bus" in page("gripper"), "the page says why")


def test_the_client_acts_and_reads_by_names(hall: Hall) -> None:
    with Fleet(hall.place.root) as fleet:
        gripper = fleet.cell.gripper
        assert {"grasp", "width", "lost"} <= set(dir(gripper))
        assert gripper.width.number == pytest.approx(0.08)
        with pytest.raises(InvalidInput, match=r"force\.value: 200 is not more than 0 to 70"):
            gripper.grasp(force=200)
        run = gripper.grasp(force=20)
        assert run.wait(timeout_s=10) == "succeeded"
        assert (run.output["holding"], run.output["width"].number) == (True, pytest.approx(0.03))
        assert run.feedback["value"].number == pytest.approx(0.03)
        assert fleet.cell.lamp.on is False
        fleet.cell.lamp.actions["on"](value=True).wait(timeout_s=10)
        assert hall.cell.lamp.lit
        with pytest.raises(AttributeError, match="nothing"):
            _ = fleet.cell.nothing


def test_what_an_action_produces_is_described_and_conforms(hall: Hall) -> None:
    done = hall.browser.page(hall.invoke("gripper/actions/grasp").headers["location"])
    shape = hall.page("gripper/actions/grasp/produceshape")
    conforms, _, text = pyshacl.validate(done.graph, shacl_graph=shape.graph)
    assert conforms, text
    assert {"holding", "width", "output", "feedback"} <= {str(each) for each in shape.graph.objects(None, SH.name)}


def test_joints_that_components_alone_move_offer_no_motions(hall: Hall) -> None:
    robot, slide = hall.page(""), hall.page("slide")
    offered = {str(each) for page in (robot, slide) for each in page.graph.objects(page.iri, HYBRIT.action)}
    assert offered == {hall.root + "actions/stop"}


def test_the_fleet_lists_the_charge_of_a_battery(hall: Hall) -> None:
    class Accumulator(Battery, blocking=False, rate_hz=100):
        left = 81.9

        @value
        def charge(self) -> Charge:
            return self.left

        @value
        def power_supply_state(self) -> PowerSupplyState:
            return "discharging"

    battery = Accumulator()
    with serving_robot(hall.place.zenoh, "cart", RobotOfComponents("Cart", battery)):
        cart = URIRef(hall.place.root + "cart/")

        def listed() -> str:
            return str(hall.browser.page(hall.place.root).graph.value(cart, LF.batteryCharge))

        eventually(lambda: listed() == "81.0", "the charge in whole per cent")
        with events(hall.place.root) as told:
            told.next()
            battery.left = 64.2
            while (said := told.next().state.value(cart, LF.batteryCharge)) is None or str(said) != "64.0":
                pass


class Scanner(Component, blocking=False):
    """Measures as many distances as asked for."""

    @value
    def profile(self) -> list[Annotated[float, unit("M")]]:
        return [0.25] * 900

    @action()
    async def scan(self, call: Call[None], count: int) -> list[Annotated[float, unit("M")]]:
        """Measure."""
        return [0.5] * count


@pytest.mark.parametrize(("count", "is_described"), [(1_000, True), (1_001, False)])
def test_a_long_result_is_one_literal(tmp_path: Any, count: int, is_described: bool) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "r", RobotOfComponents("R", Scanner())):
        action = f"{place.root}r/scanner/actions/scan"
        eventually(lambda: browser.http.get(action).status_code == 200, "the scanner")
        done = browser.http.post(action, json={"count": count}, headers=DONE).raise_for_status()
        invocation = done.headers["location"]
        said = browser.http.get(invocation, headers=JSON).json()
        assert said["output"] == [0.5] * count
        page = browser.page(invocation)
        (output,) = page.graph.objects(page.iri, LF.output)
        value = page.graph.value(output, LF.value)
        assert isinstance(value, Literal) != is_described
        assert len(list(page.graph.objects(None, VOM.numericalValue))) >= count * is_described


def test_long_values_are_described_whole(tmp_path: Any) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "r", RobotOfComponents("R", Scanner())):
        scanner, profile = f"{place.root}r/scanner", f"{place.root}r/scanner/profile"
        eventually(lambda: 0.25 in (browser.http.get(profile, headers=JSON).json().get("value") or ()), "the profile")
        for url in (scanner, profile):
            graph = browser.page(url).graph
            (head,) = graph.objects(URIRef(profile), LF.value)
            assert [float(graph.value(each, VOM.numericalValue)) for each in graph.items(head)] == [0.25] * 900
            assert graph.value(URIRef(profile), SOSA.resultTime) is not None
            assert (URIRef(scanner), HYBRIT.property, URIRef(profile)) in graph or url == profile
