"""A filled document has the same bytes as a newly written one."""

from collections.abc import Iterator

import pytest
from msgspec import structs
from pyoxigraph import Literal

from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.templates import Templates
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.serialise import TEXT_TYPES, render
from linked_fleet_rdf.templates import RowTemplate, Template
from linked_fleet_rdf.vocabulary import PREFIXES
from linked_fleet_state.events import Appeared, Described
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations

_BASE = "http://example.org:8000"
_URDF = """
<robot name="r">
  <link name="base"/><link name="arm"/><link name="ärm 2"/><link name="hand"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
  <joint name="ros:turn%2" type="revolute"><parent link="arm"/><child link="ärm 2"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
  <link name="head"/><joint name="lean" type="revolute"><parent link="arm"/><child link="head"/><axis xyz="0 1 0"/>
    <limit lower="-0.25" upper="0.5" effort="5" velocity="3"/></joint>
  <joint name="slide" type="prismatic"><parent link="ärm 2"/><child link="hand"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.5" effort="5" velocity="0.25"/></joint>
</robot>
"""


def _described() -> Iterator[Resource]:
    """Yield blueprints, actions, shapes of their results, and empty containers of invocations."""
    fleet = Fleet()
    for name in ("r", "cell 3/r-2"):
        said = Description(
            version=WIRE_VERSION, robot=name, incarnation=1, title="R", urdf=_URDF,
            joints=("turn", "ros:turn%2", "slide", "lean"), base="fixed", rate_hz=50, layout=layout(4, False),
            capabilities=("move", "stop"),
        )  # fmt: skip
        for event in (Appeared(name, 1), Described(said)):
            fleet.apply(event, 1)
    tree = Tree(fleet, Invocations(), _BASE)
    for resource, _ in tree.subtree("/"):
        stem = resource.path.rstrip("/")
        paths = [f"{stem}/blueprint"]
        for segment in ("rotate", "rotateBy", "translate", "translateBy", "hold", "stop", "moveJoints"):
            paths += [f"{stem}/actions/{segment}{end}" for end in ("", "/produceshape", "/invocations")]
        yield from [found for path in paths if isinstance(found := tree.resolve(path), Resource)]


@pytest.mark.parametrize("media_type", sorted(TEXT_TYPES))
def test_a_filled_document_equals_the_written_one(media_type: str) -> None:
    templates, filled = Templates(), 0
    for resource in _described():
        found = templates.document(resource, media_type, _BASE)
        if found is not None:
            filled += 1
            written = render(resource.full_graph(_BASE).triples, media_type, PREFIXES, base=_BASE + resource.path)
            assert found.content == written, resource.path
    assert filled > 80


@pytest.mark.parametrize("end", ["actions/rotate", "targetRotation/blueprint"])
def test_joints_with_other_limits_share_a_document(end: str) -> None:
    """A robot with two such joints has one text for both, into which their names and limits go."""
    templates = Templates()
    found = [each for each in _described() if each.path in (f"/r/turn/{end}", f"/r/lean/{end}")]
    one, other = [templates.document(each, "text/turtle", _BASE) for each in found]
    assert one is not None and other is not None and len(templates) == 1
    assert b"-57.29577" in one.content and b"-57.29577" not in other.content and b"lean" in other.content


def test_titles_with_other_characters_are_not_filled_in() -> None:
    """Some syntaxes would escape them."""
    templates = Templates()
    resource = next(each for each in _described() if each.path.endswith("/hold"))
    assert resource.template is not None
    odd = structs.replace(resource.template, literals=lambda: (Literal('a "title"'),))
    assert templates.document(resource.replace(describe=odd), "text/turtle", _BASE) is None


def test_resources_without_a_template_are_not_filled_in() -> None:
    templates, resource = Templates(), next(_described())
    plain = resource.template.__call__
    assert templates.document(resource.replace(describe=plain), "text/turtle", _BASE) is None
    assert templates.document(resource, "application/x-jelly-rdf", _BASE) is None


def test_few_are_kept() -> None:
    few, short = Templates(max_templates=2), Templates(max_characters=50_000)
    for resource in _described():
        few.document(resource, "text/turtle", _BASE)
        short.document(resource, "text/turtle", _BASE)
        assert len(few) <= 2
        assert short.of_kinds.characters <= 50_000


def _rows(*texts: str, places: tuple[int, ...] = (2, 1, 4, 3, 6, 5)) -> RowTemplate:
    return RowTemplate(Template(texts, places), 1, 2)


_ALIKE = ("<", "=", ";", "=", ";", "=", ">")


def test_a_text_has_any_number_of_rows_whose_values_may_be_in_another_order() -> None:
    found = _rows(*_ALIKE)
    assert found.fill(["0", "a", "b"]) == b"<b=a>"
    assert found.fill(["0", "a", "b", "c", "d", "e", "f", "g", "h"]) == b"<b=a;d=c;f=e;h=g>"


@pytest.mark.parametrize(
    ("texts", "places"),
    [
        (("<", "=", ";", "-", ";", "=", ">"), (1, 2, 3, 4, 5, 6)),
        (("<", "=", ";", "=", ",", "=", ">"), (1, 2, 3, 4, 5, 6)),
        (_ALIKE, (1, 2, 4, 3, 5, 6)),
        ((*_ALIKE, "!"), (1, 2, 0, 3, 4, 5, 6)),
    ],
)
def test_rows_that_are_not_written_alike_are_refused(texts: tuple[str, ...], places: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="not written alike"):
        _rows(*texts, places=places)


def test_texts_that_depend_on_the_number_of_rows_differ() -> None:
    three, places = _rows(*_ALIKE), (2, 1, 4, 3, 6, 5, 8, 7)
    assert three.has_same_text(_rows(*_ALIKE[:-1], ";", "=", ">", places=places))
    assert not three.has_same_text(_rows(*_ALIKE[:-1], ";", "=", "]", places=places))
    assert not three.has_same_text(_rows("[", *_ALIKE[1:-1], ";", "=", ">", places=places))
