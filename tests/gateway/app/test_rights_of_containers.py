"""A container of an extension asks for the rights that it names, also of readers, streams and queries."""

from collections.abc import Iterator

import pytest

from authenticated_gateway import AuthenticatedGateway, run_authenticated
from foreign_extension import installed

pytestmark = pytest.mark.virtual
SHAPES = """
@prefix sh: <http://www.w3.org/ns/shacl#> .
@prefix dcterms: <http://purl.org/dc/terms/> .
<https://example.org/my#NoteInput> a sh:NodeShape ;
    sh:property [ sh:path dcterms:title ; sh:name "title" ; sh:minCount 1 ; sh:maxCount 1 ] .
"""
CODE = """
    from contextlib import asynccontextmanager
    from pathlib import Path
    from linked_fleet_gateway.api import Container, DCTERMS, Extension, Mount, Namespace, Right

    MY = Namespace("https://example.org/my#", "Note Notes NoteInput notes")

    class Added(Extension):
        name = "added"
        at_root = ("~notes",)
        shapes = (Path(__file__).with_name("shapes.ttl"),)

        @asynccontextmanager
        async def start(self, core):
            async with core.open_container("notes", str, lambda table: Container(
                segment="~notes", title="Notes", type=MY.Notes, member_type=MY.Note, records=table,
                shape=MY.NoteInput, read=lambda body: body.text(body.root, DCTERMS.title),
                signed=lambda text, caller, client: f"{text} by {caller.name} as {client}",
                describe=lambda graph, note: None, title_of=str, predicate=MY.notes,
                writing=(Right.ACT,), reading=(Right.SUBSCRIBE,),
            )) as notes:
                yield Mount(branches=(notes.branch,))
"""


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    folder = tmp_path_factory.mktemp("rights")
    (folder / "shapes.ttl").write_text(SHAPES)
    with (
        installed(folder, "added", CODE),
        run_authenticated(folder, "--extensions", "added", robots=False) as found,
    ):
        found.add("reader", "read")
        found.add("writer", "act")
        found.add("subscriber", "read", "subscribe")
        for name in ("reader", "writer", "subscriber"):
            found.known(name)
        yield found


def test_members_are_written_by_those_with_the_right(here: AuthenticatedGateway) -> None:
    for name, status in (("reader", 403), ("subscriber", 403), ("writer", 201), ("root", 201)):
        with here.browsing(name) as browser:
            answer = browser.http.post(f"{here.root}~notes", json={"title": "a secret"})
            assert answer.status_code == status, name
    with here.browsing(None) as browser:
        assert browser.http.post(f"{here.root}~notes", json={"title": "a secret"}).status_code == 401


def test_a_write_is_checked_without_being_done(here: AuthenticatedGateway) -> None:
    with here.browsing("root") as root, here.browsing("reader") as reader:
        dry, notes = {"prefer": "dry-run"}, f"{here.root}~notes"

        def kept() -> int:
            return root.http.get(notes, headers={"accept": "text/turtle"}).text.count("a plan")

        checked = root.http.post(notes, json={"title": "a plan"}, headers=dry)
        assert (checked.status_code, checked.headers["preference-applied"], kept()) == (204, "dry-run", 0)
        assert root.http.post(notes, json={"titel": "a plan"}, headers=dry).status_code == 422
        assert reader.http.post(notes, json={"title": "a plan"}, headers=dry).status_code == 403
        note = root.http.post(notes, json={"title": "a plan"}).headers["location"]
        assert root.http.put(note, json={"title": "another"}, headers=dry).status_code == 204
        assert root.http.put(note, json={"titel": "another"}, headers=dry).status_code == 422
        assert root.http.delete(note, headers=dry).status_code == 400
        assert kept() == 1
        assert root.http.delete(note).status_code == 204


@pytest.mark.parametrize("accept", ["text/turtle", "text/html", "text/event-stream"])
def test_members_are_read_by_those_with_the_right(here: AuthenticatedGateway, accept: str) -> None:
    with here.browsing("root") as browser:
        location = browser.http.post(f"{here.root}~notes", json={"title": "a secret"}).headers["location"]
    for url in (f"{here.root}~notes", location, f"{location}/blueprint"):
        for name in ("reader", "writer"):
            with here.browsing(name) as browser:
                answer = browser.http.get(url, headers={"accept": accept})
                assert answer.status_code == 403 or url.endswith("/blueprint"), (name, url)
                assert "a secret" not in answer.text
    with (
        here.browsing("subscriber") as browser,
        browser.http.stream("GET", location, headers={"accept": accept}) as said,
    ):
        assert said.status_code == 200


def test_queries_do_not_tell_what_their_caller_may_not_read(here: AuthenticatedGateway) -> None:
    with here.browsing("root") as browser:
        browser.http.post(f"{here.root}~notes", json={"title": "a secret"})
    for name in ("reader", "subscriber"):
        with here.browsing(name) as browser:
            query = "SELECT ?title { ?note <http://purl.org/dc/terms/title> ?title }"
            answer = browser.http.get(f"{here.root}query", params={"query": query}, headers={"accept": "text/csv"})
            assert answer.status_code == 200 and "a secret" not in answer.text


def test_a_record_keeps_who_has_written_it(here: AuthenticatedGateway) -> None:
    with here.browsing("writer") as writer, here.browsing("subscriber") as subscriber:
        note = writer.http.post(f"{here.root}~notes", json={"title": "signed"}).headers["location"]
        assert "signed by writer as writer" in subscriber.http.get(note, headers={"accept": "text/turtle"}).text
