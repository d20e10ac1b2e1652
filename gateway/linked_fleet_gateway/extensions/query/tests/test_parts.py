"""Queries see the components of robots as GET serves them."""

from collections.abc import Mapping
from typing import Any

import msgspec
import pytest
from pyoxigraph import QuerySolutions

from component_cell import Cell as Driver
from linked_fleet_agent.wire.components import COMPONENTS_VERSION, Measured, Occurrence, Values, read_declarations
from linked_fleet_gateway.extensions.components.part import parts_from
from linked_fleet_gateway.extensions.components.state import RobotState
from linked_fleet_gateway.extensions.query.rdf_mirror import RdfMirror
from linked_fleet_state.invocation import Invocation, InvocationState
from mirrored_fleet import MirroredFleet
from mirrored_graphs import BASE, canonical, held, served
from running import eventually
from small_fleet import Place
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
_NUMBER = {"type": "number", "unit": "M"}
_PIECE = {"type": "object", "properties": {"label": {"type": "string"}, "size": _NUMBER}}
DECLARED = [
    {
        "name": "gripper",
        "description": "Two fingers.",
        "properties": {
            "width": {"schema": _NUMBER},
            "lit": {"schema": {"type": "boolean"}, "writable": True},
            "pieces": {"schema": {"type": "array", "items": _PIECE, "maxItems": 4}},
        },
        "actions": {"grasp": {"input": {"type": "object", "properties": {"width": _NUMBER}}, "result": _NUMBER}},
        "events": {"lost": {"data": _NUMBER}},
    },
    {"name": "lamp", "properties": {"hue": {"schema": {"type": "string"}}}},
]
_WIDTHS = """PREFIX lf: <https://w3id.org/linked-fleet#>
PREFIX vom: <http://vocab.arvida.de/2015/06/vom/vocab#>
SELECT DISTINCT ?w { ?g a lf:Component ; ?p ?v . ?v a lf:ComponentProperty ; lf:value/vom:numericalValue ?w }"""


def _raw(value: object) -> msgspec.Raw:
    return msgspec.Raw(msgspec.json.encode(value))


class Cell:
    """A robot with components, and the mirror of its fleet."""

    def __init__(self, name: str = "cell") -> None:
        self.fleet, self.rdf, self.name, self._said = MirroredFleet(), RdfMirror(BASE), name, 0
        self.describe()

    def describe(self, run: int = 1, declared: Any = DECLARED) -> None:
        text = msgspec.json.encode(declared)
        self.fleet.describe(self.name, run, components=text)
        robot = self.fleet.fleet.robots[self.name]
        assert robot.model is not None
        components, refused = read_declarations(text, robot.model.links, robot.model.joints)
        self.state = RobotState(components, run)
        robot.set_parts(parts_from(robot, robot.model, components, self.state), refused)

    def say(self, component: str = "gripper", fault: str = "", **values: Any) -> None:
        self._said += 1
        measured = Measured(at_ns=self._said, values={name: _raw(each) for name, each in values.items()}, fault=fault)
        said = Values(
            version=COMPONENTS_VERSION, incarnation=self.state.incarnation, sequence=self._said,
            monotonic_ns=self._said, wall_ns=self._said * 10**9, components={component: measured},
        )  # fmt: skip
        self.state.hear(said)

    def happen(self, data: float) -> None:
        said = Occurrence(
            version=COMPONENTS_VERSION, incarnation=self.state.incarnation, sequence=1, monotonic_ns=1,
            wall_ns=7 * 10**9, component="gripper", event="lost", data=_raw(data),
        )  # fmt: skip
        assert self.state.happen(said)

    def same(self) -> None:
        self.rdf.update(self.fleet.bring())
        assert canonical(held(self.rdf, self.name)) == canonical(served(self.fleet, self.name))

    def widths(self) -> list[str]:
        found = self.rdf.store.query(_WIDTHS, use_default_graph_as_union=True)
        assert isinstance(found, QuerySolutions)
        return [row["w"].value for row in found]


@pytest.fixture
def cell() -> Cell:
    return Cell()


def test_components_are_as_they_are_served_whatever_happens(cell: Cell) -> None:
    cell.same()  # no value yet
    cell.say(width=0.05, lit=True, pieces=[{"label": "nut", "size": 0.5}, {"label": "bolt"}])
    cell.same()
    cell.say("lamp", hue="red")
    cell.same()
    cell.say(width=0.04, pieces=[{"label": "bolt"}], lit=None, fault="lit cannot be read")
    cell.fleet.stand("cell", (0.1, 0.2))
    cell.same()
    cell.happen(0.25)
    cell.same()
    cell.happen(0.25)
    cell.same()
    list(cell.state.expire(10**12))
    cell.same()
    cell.say(width=0.03)
    cell.fleet.leave("cell")
    cell.same()
    cell.describe(2)
    cell.same()
    cell.say(width=0.02)
    cell.same()
    cell.describe(2, [*DECLARED[:1], {"name": "lamp", "properties": {"hue": {"schema": {"type": "colour"}}}}])
    cell.same()  # one that is refused, with its reason
    cell.describe(3, [])
    cell.same()


def test_a_query_finds_the_present_values(cell: Cell) -> None:
    cell.say(width=0.05)
    cell.same()
    assert cell.widths() == ["0.05"]
    cell.say(width=0.04)
    cell.same()
    assert cell.widths() == ["0.04"]


def test_values_stay_when_the_robot_is_described_in_other_words(cell: Cell) -> None:
    """The gateway keeps its parts and their values, which are not measured again."""
    cell.say(width=0.05)
    cell.same()
    cell.fleet.describe("cell", annotations='<> <http://x/made> "again" .', components=msgspec.json.encode(DECLARED))
    cell.same()
    assert cell.widths() == ["0.05"]


@pytest.mark.parametrize("outcome", [{"feedback": "0.5"}, {"outcome": "0.25", "state": InvocationState.SUCCEEDED}])
def test_invocations_have_their_feedback_and_result(cell: Cell, outcome: Mapping[str, Any]) -> None:
    one = Invocation("i-1", "cell", "/cell/gripper/actions/grasp", {}, 10**9, 10**10, InvocationState.RUNNING)
    cell.fleet.invocations.add(one)
    cell.same()
    for name, value in outcome.items():
        setattr(one, name, value)
    cell.same()


def test_only_robots_whose_values_have_changed_are_sent(cell: Cell) -> None:
    cell.fleet.describe("plain")
    cell.say(width=0.05)
    assert set(cell.fleet.news().values) == {"cell"}
    assert not cell.fleet.news().values
    cell.say(width=0.05)
    assert not cell.fleet.news().values
    cell.happen(0.5)
    news = cell.fleet.news()
    assert (set(news.values), news.robots, news.frames) == ({"cell"}, [], {})


def test_only_statements_about_what_has_changed_are_written(cell: Cell) -> None:
    cell.say(width=0.05, lit=True)
    cell.same()
    before = set(cell.rdf.store)
    cell.say(width=0.04)
    cell.same()
    changed = {quad.predicate.value.rpartition("#")[2].rpartition("/")[2] for quad in before ^ set(cell.rdf.store)}
    assert changed == {"numericalValue", "resultTime"}


def test_the_endpoint_answers_from_the_components_of_a_real_driver(tmp_path: Any) -> None:
    place, driver = Place(tmp_path), Driver()
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "cell", driver):

        def widths() -> list[str]:
            answer = browser.http.get(f"{place.root}query", params={"query": _WIDTHS}, headers={"accept": "text/csv"})
            return answer.raise_for_status().text.split()[1:]

        eventually(lambda: {"0.08", "3"} == set(widths()), "the values of gripper and lamp")
        driver.gripper.gap = 0.05
        eventually(lambda: {"0.05", "3"} == set(widths()), "the changed value")
