"""A copied document has the same bytes as a newly written one."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description
from linked_fleet_gateway.fleet.events import Appeared, Described
from linked_fleet_gateway.fleet.fleet import Fleet
from linked_fleet_gateway.fleet.invocations import Invocations
from linked_fleet_gateway.rdf.serialise import TEXT_TYPES, render
from linked_fleet_gateway.rdf.vocabulary import PREFIXES
from linked_fleet_gateway.resources.renderings import Copies
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree

_BASE = "http://example.org:8000"
_URDF = """
<robot name="r">
  <link name="base"/><link name="arm"/><link name="ärm 2"/><link name="hand"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
  <joint name="ros:turn%2" type="revolute"><parent link="arm"/><child link="ärm 2"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
  <joint name="slide" type="prismatic"><parent link="ärm 2"/><child link="hand"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.5" effort="5" velocity="0.25"/></joint>
</robot>
"""


def _blueprints() -> Iterator[Resource]:
    fleet = Fleet()
    for name in ("r", "cell 3/r-2"):
        said = Description(
            version=WIRE_VERSION, robot=name, incarnation=1, title="R", urdf=_URDF,
            joints=("turn", "ros:turn%2", "slide"), base="fixed", rate_hz=50, layout=layout(3, False),
            capabilities=("move",),
        )  # fmt: skip
        for event in (Appeared(name, 1), Described(said)):
            fleet.apply(event, 1)
    tree = Tree(fleet, Invocations(), _BASE)
    for resource, _ in tree.subtree("/"):
        found = tree.resolve(resource.path.rstrip("/") + "/blueprint")
        if isinstance(found, Resource):
            yield found


@pytest.mark.parametrize("media_type", sorted(TEXT_TYPES))
def test_a_copy_equals_the_rendered_document(media_type: str) -> None:
    copies, copied = Copies(), 0
    for resource in _blueprints():
        body = copies.body(resource, media_type, _BASE)
        if body is not None:
            copied += 1
            written = render(resource.whole(_BASE).triples, media_type, PREFIXES, base=_BASE + resource.path)
            assert body == written, resource.path
    assert copied > 40


def test_resources_without_a_template_are_not_copied() -> None:
    copies = Copies()
    resource = next(_blueprints())
    assert copies.body(replace(resource, template=None), "text/turtle", _BASE) is None
    assert copies.body(resource, "application/x-jelly-rdf", _BASE) is None


def test_few_are_kept() -> None:
    copies = Copies(most=2)
    for resource in _blueprints():
        copies.body(resource, "text/turtle", _BASE)
    assert len(copies._kept) <= 2
