"""Kinds of actions by extensions that are no motions: outputs, failures, stops, rights, and segments."""

import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from rdflib import Literal

from browser import DCTERMS, LF, Browser
from foreign_extension import installed
from running import eventually, process
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
_PREFIXES = """
@prefix dcterms: <http://purl.org/dc/terms/> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix sh: <http://www.w3.org/ns/shacl#> .
@prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> .
@prefix http-core: <http://www.w3.org/2011/http#> .
@prefix http-methods: <http://www.w3.org/2011/http-methods#> .
@prefix lf: <https://w3id.org/linked-fleet#> .
@prefix my: <https://example.org/my#> .
"""
_KIND = """
my:{0} a lf:ActionKind ; lf:segment "{1}" ; lf:offeredBy {2} ; dcterms:title "{0}" ; rdfs:comment "{0}." ; {3}
    http-core:mthd http-methods:POST ; hybrit:produces lf:InvocationShape .
"""
KINDS = _PREFIXES + "".join(
    _KIND.format(*each)
    for each in (
        ("Count", "count", "lf:Fleet", ""),
        ("Fail", "fail", "lf:Fleet", ""),
        ("Hang", "hang", "lf:Robot", ""),
        ("Late", "late", "lf:Fleet", ""),
        ("Lock", "lockAll", "lf:Fleet", "lf:isStop true ;"),
        ("Relay", "relay", "lf:Fleet", ""),
    )
)
CODE = """
    import asyncio
    from contextlib import asynccontextmanager
    from pathlib import Path
    from linked_fleet_gateway.api import *
    from linked_fleet_gateway.faces import offers_at
    from linked_fleet_gateway.serving import Caller
    from linked_fleet_gateway.extensions.pages.api import PageView, Part

    MY = Namespace("https://example.org/my#", "Count Fail Hang Late Lock Relay Note Notes NoteInput counted")

    async def count(call):
        call.accept()
        call.report(0.5, "counting")
        graph = Graph()
        root = graph.blank()
        graph.add(root, MY.counted, integer(3))
        call.set_output(graph.triples, root)

    async def fail(call):
        raise RuntimeError("planted")

    async def hang(call):
        call.accept(60.0)
        await asyncio.sleep(3600)

    async def late(call):
        await asyncio.sleep(3600)

    async def lock(call):
        call.accept()

    def relay(core):
        async def run(call):
            (count,) = [each for each in offers_at(None) if each.definition.segment == "count"]
            counting = await core.invoke(count, "http://localhost", Caller("a butler"))
            if not await core.wait_until(counting, lambda one: one.state.terminal, 10.0):
                raise RuntimeError("it did not end")
            call.accept()
        return run

    class Added(Extension):
        name = "added"
        at_root = ("~notes",)
        kinds = shapes = (Path(__file__).with_name("kinds.ttl"),)

        def views(self):
            here = Path(__file__).parent
            return (PageView(MY.Notes, here / "notes.html", lambda facts, iri: Part(), files=(here / "notes.js",)),)

        @asynccontextmanager
        async def start(self, core):
            runs = {MY.Count: count, MY.Fail: fail, MY.Hang: hang, MY.Late: late, MY.Lock: lock, MY.Relay: relay(core)}
            async with core.open_container("notes", str, lambda table: Container(
                segment="~notes", title="Notes", type=MY.Notes, member_type=MY.Note, records=table,
                shape=MY.NoteInput, read=lambda body: body.text(body.root, DCTERMS.title),
                describe=lambda graph, note: None, title_of=str,
            )) as notes:
                handlers = {kind: (lambda request, run=run: Operation(run)) for kind, run in runs.items()}
                yield Mount(branches=(notes.branch,), handlers=handlers)
"""
_INPUT = """
my:NoteInput a sh:NodeShape ; sh:property [ sh:path dcterms:title ; sh:name "title" ; sh:minCount 1 ; sh:maxCount 1 ] .
"""


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    folder = tmp_path
    (folder / "kinds.ttl").write_text(KINDS + _INPUT)
    (folder / "notes.html").write_text('{% extends "frame.html" %}')
    (folder / "notes.js").write_text("console.log('notes');")
    place = Place(folder / "state")
    flags = ("--extensions", "added", "--requests-per-client", "20")
    with installed(folder, "added", CODE), process(*place.command(), *flags) as one:
        one.said("serving")
        with process("-m", "linked_fleet_agent", "--robot=jotter=ur5", "--connect", place.zenoh):
            found = Browser(place.root)
            live(found, "jotter")
            yield found
            found.close()


def post(browser: Browser, action: str, **fields: str) -> httpx.Response:
    return browser.http.post(f"{browser.root}{action}", headers=fields)


def test_an_output_is_part_of_the_invocation(browser: Browser) -> None:
    answer = post(browser, "actions/count", prefer="return=representation, wait=5", accept="text/turtle")
    assert answer.status_code == 201, answer.text
    page = browser.page(answer.headers["location"])
    output = page.one(LF.output)
    assert str(page.graph.value(output, None) or page.graph.objects(output)) and "counted" in answer.text
    assert page.one(LF.state) == LF.succeeded


def test_an_extension_invokes_an_action_for_a_client(browser: Browser) -> None:
    assert post(browser, "actions/relay", prefer="wait=10").status_code == 204
    counted = browser.page(f"{browser.root}actions/count/invocations").graph
    assert set(counted.objects(None, LF.state)) == {LF.succeeded}
    (invocation,) = counted.subjects(LF.state)
    assert browser.page(str(invocation)).graph.value(None, DCTERMS.title, Literal("a butler")) is not None


def test_an_operation_that_raises_ends_its_invocation_and_answers(browser: Browser) -> None:
    answer = post(browser, "actions/fail")
    assert answer.status_code == 500 and "planted" not in answer.text
    listed = browser.page(f"{browser.root}actions/fail/invocations")
    assert LF.failed in set(listed.graph.objects(None, LF.state))


def test_an_operation_that_neither_accepts_nor_refuses_is_given_up(browser: Browser) -> None:
    answer = post(browser, "actions/late")
    assert answer.status_code == 504, answer.text


def test_a_stop_of_its_robot_cancels_an_operation(browser: Browser) -> None:
    location = post(browser, "jotter/actions/hang").headers["location"]
    assert browser.page(location).one(LF.state) == LF.running
    assert post(browser, "jotter/actions/stop").status_code == 204
    eventually(lambda: browser.page(location).one(LF.state) == LF.cancelled, "the end of the operation")


def test_an_operation_can_be_deleted_with_its_invocation(browser: Browser) -> None:
    location = post(browser, "jotter/actions/hang").headers["location"]
    assert browser.http.delete(location).status_code == 204
    assert browser.http.get(location).status_code == 404


def test_a_kind_that_is_a_stop_is_not_limited_by_rate_and_ignores_fields(browser: Browser) -> None:
    fields = {"if-match": '"other"', "prefer": "handling=strict, x"}
    for _ in range(250):
        assert post(browser, "actions/lockAll", **fields).status_code == 204
    assert 429 in {post(browser, "actions/nothing").status_code for _ in range(250)}


def test_a_segment_with_a_tilde_renames_no_robot(browser: Browser) -> None:
    eventually(lambda: browser.http.get(f"{browser.root}jotter/").status_code == 200, "the rate limit to pass")
    answer = browser.http.post(f"{browser.root}~notes", json={"title": "a note"})
    assert answer.status_code == 201, answer.text
    assert httpx.URL(answer.headers["location"]).path.startswith("/~notes/")


def test_a_page_has_the_files_of_its_view(browser: Browser) -> None:
    def page() -> str:
        answer = browser.http.get(f"{browser.root}~notes", headers={"accept": "text/html"})
        return answer.text if answer.status_code == 200 else ""

    text = eventually(page, "the page")
    name = text.partition('<script type="module" src="/assets/notes-')[2].partition('"')[0]
    script = browser.http.get(f"{browser.root}assets/notes-{name}")
    assert script.text == "console.log('notes');" and "immutable" in script.headers["cache-control"]
    assert json.dumps(script.headers["content-type"]).startswith('"text/javascript')
