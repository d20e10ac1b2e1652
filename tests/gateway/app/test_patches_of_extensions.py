"""An extension reads further bodies of PATCH; resources that take PATCH take them too."""

from collections.abc import Iterator

import pytest

from authenticated_gateway import SEEN, AuthenticatedGateway, run_authenticated
from foreign_extension import installed

pytestmark = pytest.mark.virtual
UPDATE, RENAMING = "application/sparql-update", "application/x-renaming"
CODE = """
    from pyoxigraph import Triple
    from linked_fleet_gateway.api import BadRequest, Extension, LF, Literal, NamedNode

    def read(content, iri):
        name = content.decode()
        if not name.isalpha():
            raise BadRequest("A name is of letters.")

        def patch(triples):
            of = NamedNode(iri), LF.value
            others = [each for each in triples if (each.subject, each.predicate) != of]
            return [*others, Triple(*of, Literal(name))]

        return patch

    class Added(Extension):
        name = "added"
        patches = {"application/x-renaming": read}
"""


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    folder = tmp_path_factory.mktemp("patches")
    with installed(folder, "added", CODE), run_authenticated(folder, "--extensions", "added") as found:
        yield found


def test_a_resource_is_patched_by_what_an_extension_reads(here: AuthenticatedGateway) -> None:
    with here.browsing("root") as root:
        url = f"{here.root}{SEEN}/title"
        assert root.http.put(url, json={"value": "Before"}).status_code == 204
        assert root.http.get(url).headers["accept-patch"] == f"{UPDATE}, {RENAMING}"
        assert root.http.patch(url, content="After", headers={"content-type": RENAMING}).status_code == 204
        assert '"After"' in root.http.get(url).text and '"Before"' not in root.http.get(url).text
        refused = root.http.patch(url, content="4", headers={"content-type": RENAMING})
        assert (refused.status_code, refused.json()["detail"]) == (400, "A name is of letters.")
        unknown = root.http.patch(url, content="4", headers={"content-type": "text/plain"})
        assert (unknown.status_code, unknown.headers["accept-patch"]) == (415, f"{UPDATE}, {RENAMING}")


def test_descriptions_of_the_interface_name_it(here: AuthenticatedGateway) -> None:
    with here.browsing("root") as root:
        item = root.http.get(f"{here.root}openapi.json").json()["paths"]["/{robot}/title"]
        assert set(item["patch"]["requestBody"]["content"]) == {UPDATE, RENAMING}
