"""Contents above half a megabyte are compressed too."""

from collections.abc import Iterator

import httpx
import pytest

from authenticated_gateway import AuthenticatedGateway, run_authenticated
from foreign_extension import installed
from linked_fleet_gateway.http.negotiation import MOST_BYTES

pytestmark = pytest.mark.virtual
_LONG = f"""
    from contextlib import asynccontextmanager
    from pyoxigraph import Literal, NamedNode
    from linked_fleet_gateway.http.extension import Extension, Mount
    from linked_fleet_gateway.resources.branches import FleetBranch
    from linked_fleet_gateway.resources.resource import Resource

    def describe(graph):
        graph.add(NamedNode("urn:x:long"), NamedNode("urn:x:text"), Literal("x" * {MOST_BYTES}))

    class Added(Extension):
        name, at_root = "long", ("long",)

        @asynccontextmanager
        async def start(self, core):
            yield Mount(branches=(FleetBranch("long", None, lambda view, rest: Resource("/long", "L", describe)),))
"""


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    folder = tmp_path_factory.mktemp("long")
    with installed(folder, "long", _LONG), run_authenticated(folder, "--extensions", "long", robots=False) as one:
        yield one


def _get(here: AuthenticatedGateway, coding: str, **fields: str) -> httpx.Response:
    headers = {"authorization": f"Bearer {here.tokens['root']}", "accept": "text/turtle", "accept-encoding": coding}
    with httpx.Client() as client:
        return client.get(f"{here.root}long", headers=headers | fields)


def test_a_client_that_takes_gzip_gets_long_contents_in_it(here: AuthenticatedGateway) -> None:
    plain, coded = _get(here, "identity"), _get(here, "gzip")
    assert "content-encoding" not in plain.headers and len(plain.content) > MOST_BYTES
    assert coded.headers["content-encoding"] == "gzip" and coded.content == plain.content
    assert int(coded.headers["content-length"]) < len(plain.content) / 100
    assert coded.headers["etag"] == plain.headers["etag"][:-1] + '-gzip"'


@pytest.mark.parametrize("coding", ["identity", "gzip"])
def test_a_client_that_knows_long_contents_gets_304(here: AuthenticatedGateway, coding: str) -> None:
    tag = _get(here, coding).headers["etag"]
    again = _get(here, coding, **{"if-none-match": tag})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
    other = _get(here, "gzip" if coding == "identity" else "identity", **{"if-none-match": tag})
    assert other.status_code == 200 and other.headers["etag"] != tag
