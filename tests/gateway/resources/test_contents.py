"""What is known of a document of a resource before it is written."""

import pytest

from linked_fleet_gateway.resources.message_body import message_types
from linked_fleet_gateway.resources.resource import Rendition, Resource
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import RDF_TYPES


def _describe(graph: Graph) -> None:
    """Add nothing."""


@pytest.mark.parametrize("constant", [False, True])
def test_constant_contents_are_in_no_message(constant: bool) -> None:
    documents = {"text/csv": lambda: b"", "image/png": Rendition(lambda: b"", is_constant=constant)}
    found = message_types(Resource("/r/a", "a", _describe, documents=documents))
    assert found == (*RDF_TYPES, "text/csv", *(() if constant else ("image/png",)))


def test_a_function_is_a_content_of_which_nothing_is_known() -> None:
    named = Rendition(lambda: b"1,2", "a.csv", {"gzip": b"x"})
    resource = Resource("/r/a", "a", None, documents={"text/csv": named, "image/png": lambda: b"png"})
    assert resource.rendition("text/csv") is named
    plain = resource.rendition("image/png")
    assert plain is not None and (plain(), plain.file_name, plain.codings) == (b"png", "", {})
    assert resource.rendition("text/turtle") is None


def test_a_resource_has_few_fields() -> None:
    assert len(Resource.__struct_fields__) <= 20
