"""A template of a description gives, byte for byte, the same as the description itself for the same values."""

import itertools
import math
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import NamedNode

from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description
from linked_fleet_gateway.resources.description import MeasuredDescription
from linked_fleet_gateway.resources.property import Measurement
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription_resource import describe_version
from linked_fleet_gateway.resources.templates import Rendering, Versions, is_measured
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import TEXT_TYPES, render
from linked_fleet_rdf.templates import Markers
from linked_fleet_rdf.vocabulary import PREFIXES, XSD
from linked_fleet_state.events import Appeared, Described
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations
from properties import examples

_BASE = "http://example.org"
_URDF = """
<robot name="r">
  <link name="base"/><link name="arm"/><link name="hand"/>
  <joint name="50%s turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
  <joint name="slide" type="prismatic"><parent link="arm"/><child link="hand"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.5" effort="5" velocity="0.25"/></joint>
</robot>
"""
_JOINTS = ("50%s turn", "slide")


def _measured() -> list[Resource]:
    fleet = Fleet()
    said = Description(
        version=WIRE_VERSION, robot="r", incarnation=1, title="R", urdf=_URDF, joints=_JOINTS, base="floating",
        rate_hz=50, layout=layout(len(_JOINTS), True), capabilities=("move",),
    )  # fmt: skip
    for event in (Appeared("r", 1), Described(said)):
        fleet.apply(event, 1)
    found = [resource for resource, _ in Tree(fleet, Invocations(), _BASE).subtree("/")]
    robot, state = (Tree(fleet, Invocations(), _BASE).resolve(path) for path in ("/r/", "/r/jointState"))
    assert isinstance(robot, Resource) and isinstance(state, Resource)
    return [
        each
        for each in ({each.path: each for each in (*found, robot, state)}).values()
        if isinstance(each.describe, MeasuredDescription) and each.describe.samplers
    ]


_RESOURCES = {each.path: each for each in _measured()}
_VALUES = st.one_of(
    st.floats(width=64),
    st.sampled_from([math.nan, 0.0, -0.0, 8.1e211]),
    st.floats(-7, 7).map(lambda value: round(value, 5)),
)
_TIMES = st.none() | st.integers(0, 250_000_000_000 * 1_000_000_000)
_DIGEST = st.from_regex(r"[0-9a-f]{16}", fullmatch=True)
_NUMBERS = st.from_regex(r"[0-9]{1,9}-[0-9]{1,9}", fullmatch=True)
_VERSIONS = st.none() | st.builds(Versions, _NUMBERS, _NUMBERS, st.none() | _DIGEST)


def _written(
    resource: Resource, media_type: str, measurements: Sequence[Measurement], versions: Versions | None
) -> bytes:
    graph = Graph()
    assert isinstance(resource.describe, MeasuredDescription)
    resource.describe.describe(graph, measurements)
    resource.add_interaction_model(graph, _BASE)
    if versions is not None:
        describe_version(graph, NamedNode(_BASE + resource.path), *versions)
    return render(graph.triples, media_type, PREFIXES, base=_BASE + resource.path)


def _counts(resource: Resource) -> list[int]:
    assert isinstance(resource.describe, MeasuredDescription)
    return [len(each.values) for each in resource.describe.measure()]


def test_all_that_is_measured_has_a_template() -> None:
    ends = {path.rpartition("/")[2] for path in _RESOURCES}
    values = {"rotation", "translation", "velocity", "effort", "pose", "twist", "jointState"}
    assert ends > values, "joints and links too"
    assert all(is_measured(each, media_type) for each in _RESOURCES.values() for media_type in TEXT_TYPES)


@pytest.mark.parametrize(("path", "media_type"), list(itertools.product(_RESOURCES, TEXT_TYPES)))
@settings(max_examples=examples(20))
@given(data=st.data())
def test_filled_documents_equal_written_ones(path: str, media_type: str, data: st.DataObject) -> None:
    """For one document after another, also when values become unknown and known again."""
    resource = _RESOURCES[path]
    rendering, counts = Rendering(resource, media_type, _BASE), _counts(resource)
    for _ in range(3):
        measurements = [
            Measurement(tuple(data.draw(st.lists(_VALUES, min_size=count, max_size=count))), data.draw(_TIMES))
            for count in counts
        ]
        versions = data.draw(_VERSIONS)
        assert rendering.render(measurements, versions) == _written(resource, media_type, measurements, versions)


@pytest.mark.parametrize("path", _RESOURCES)
def test_a_description_shows_what_is_measured(path: str) -> None:
    resource = _RESOURCES[path]
    graph = resource.full_graph(_BASE)
    written = render(graph.triples, "text/turtle", PREFIXES, base=_BASE + path)
    rendering = Rendering(resource, "text/turtle", _BASE)
    assert rendering.render_current() == written
    assert rendering.render_observations(resource.source.sample()) == written


@pytest.mark.parametrize("datatype", [XSD.string, XSD.float, XSD.dateTime, XSD.integer, XSD.decimal])
def test_a_text_that_begins_as_a_marker_does_stays(datatype: NamedNode) -> None:
    markers = Markers()
    first, other = (markers.literal(index, datatype).value for index in (0, 1))
    text = f"{first[:-1]} 5% {other} {first}"
    assert markers.template(text).fill(["a", "b"]).decode() == f"{first[:-1]} 5% b a"
