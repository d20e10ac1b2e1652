"""RFC 8288 and RFC 9264."""

import json

from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.http.fields import Link, link_header, linkset_json, linkset_text
from linked_fleet_gateway.http.read import resource_headers
from linked_fleet_gateway.http.representation import Representations
from linked_fleet_gateway.resources.branches import Branches, FleetBranch
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations

LINKS = st.lists(
    st.builds(Link, st.text(max_size=80), st.text(max_size=20), st.none() | st.text(max_size=20)), max_size=40
)


@given(LINKS, LINKS, st.none() | st.text(max_size=900), st.integers(0, 800))
def test_always_below_the_limit_and_a_field_value(
    own: list[Link], parts: list[Link], linkset: str | None, limit: int
) -> None:
    """Whatever the links, the value fits and is valid in a header."""
    value = link_header(own, parts, linkset, limit)
    assert len(value) < max(limit, 1)
    value.replace("\x80", "").encode("latin-1", "replace")
    assert not set(value) & {"\r", "\n", "\0"}


def test_own_first_then_parts_then_the_link_set() -> None:
    """A robot with two hundred parts keeps its own links, and links the rest."""
    own = [Link("/baxter/subscriptions", "related"), Link("http://www.w3.org/ns/ldp#Resource", "type")]
    parts = [Link(f"/baxter/part_{number}", "related", "text/turtle") for number in range(200)]
    value = link_header(own, parts, "/baxter/linkset")
    assert 3900 < len(value) < 4096
    assert value.startswith('</baxter/subscriptions>; rel="related", <http://www.w3.org/ns/ldp#Resource>; rel="type"')
    assert value.endswith('</baxter/linkset>; rel="linkset"; type="application/linkset+json"')


def test_values_cannot_break_out_of_a_link_field() -> None:
    """Brackets, quotes and letters beyond ASCII cannot end a target or a parameter."""
    value = link_header([Link('/a>; rel="x", <é%20%', 'a"b\\')], [])
    assert value == '</a%3E;%20rel=%22x%22,%20%3C%C3%A9%20%25>; rel="a\\"b\\\\"'.replace("%C3%A9%20%25", "%C3%A9%20%25")


def test_link_set_documents() -> None:
    """Targets are grouped by relation under their anchor, in both formats."""
    links = [Link("/a", "related", "text/turtle"), Link("/b", "related"), Link("/c", "type")]
    assert json.loads(linkset_json("/x", links)) == {
        "linkset": [
            {
                "anchor": "/x",
                "related": [{"href": "/a", "type": "text/turtle"}, {"href": "/b"}],
                "type": [{"href": "/c"}],
            }
        ]
    }
    assert linkset_text("/x", links[:1]) == b'</a>; rel="related"; type="text/turtle"; anchor="/x"'


def test_the_fleet_has_links_of_extensions_with_their_relations() -> None:
    """In the Link field and in the link set, with the media type."""
    branch = FleetBranch("api", None, lambda view, rest: None, link=("service-desc", "application/x-api"))
    tree = Tree(Fleet(), Invocations(), "http://fleet.example", branches=Branches().with_branches(branch))
    fleet, linkset = tree.resolve("/"), tree.resolve("/linkset")
    assert isinstance(fleet, Resource) and isinstance(linkset, Resource)
    expected = '<http://fleet.example/api>; rel="service-desc"; type="application/x-api"'
    assert expected in resource_headers(fleet, "http://fleet.example", '"1"')["link"]
    (context,) = json.loads(Representations().negotiate(None, linkset, "http://fleet.example").body)["linkset"]
    assert context["service-desc"] == [{"href": "http://fleet.example/api", "type": "application/x-api"}]
