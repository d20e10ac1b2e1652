"""A faulty extension is left out and named; the gateway serves everything else."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from browser import LF, Browser
from foreign_extension import installed
from linked_fleet_gateway.http.extension import Extension
from running import process
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
HEAD = """
    from contextlib import asynccontextmanager
    from pathlib import Path
    from linked_fleet_gateway.api import *
    from linked_fleet_gateway.extensions.pages.api import PageView, Part

    KIND = (
        "@prefix lf: <https://w3id.org/linked-fleet#> . @prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> . "
        "<https://example.org/Open> a lf:ActionKind ; lf:segment 'open' ; lf:offeredBy lf:Fleet ; "
        "<http://purl.org/dc/terms/title> 'Open' ; <http://www.w3.org/2000/01/rdf-schema#comment> 'Opens.' ; "
        "<http://www.w3.org/2011/http#mthd> <http://www.w3.org/2011/http-methods#POST> ; "
        "hybrit:produces lf:InvocationShape ."
    )
    NOTE = (
        "@prefix sh: <http://www.w3.org/ns/shacl#> . <https://example.org/NoteInput> a sh:NodeShape ; sh:property "
        "[ sh:path <http://purl.org/dc/terms/title> ; sh:name 'title' ; sh:minCount 1 ; sh:maxCount 1 ] ."
    )

    def fail(*_):
        raise RuntimeError("planted")

    def file(name, content):
        made = Path(__file__).with_name(name)
        made.write_text(content)
        return made

    class Added(Extension):
        name = "added"
"""
START = """
        @asynccontextmanager
        async def start(self, core):
"""
# The rest of the class, and the words by which the fault is named.
FAULTY = {
    "start": (START + """
            raise RuntimeError("planted")
            yield
""", "extensions: added failed: RuntimeError: planted"),
    "metrics": (START + """
            yield Mount(metrics=fail)
""", "metrics: added failed: RuntimeError: planted"),
    "view": ("""
        def views(self):
            return ("no view",)
""", "pages: views of added failed: TypeError: a view is a PageView"),
    "module of a view": ("""
        def views(self):
            import no_such_module
""", "pages: views of added failed: ModuleNotFoundError"),
    "operations": ("""
        operations = fail
""", "OpenAPI: operations of added failed: RuntimeError: planted"),
    "Turtle": ("""
        shapes = (file("broken.ttl", "@prefix my: <https://example.org/> . my:a my:b"),)
""", "extensions: added failed: ValueError: broken.ttl: "),
    "missing file": ("""
        kinds = (Path("/no/such/kinds.ttl"),)
""", "extensions: added failed: ValueError: kinds.ttl: "),
    "SHACL that is not supported": ("""
        shapes = (file("sparql.ttl", "<https://example.org/Bad> a <http://www.w3.org/ns/shacl#NodeShape> ; "
                                     "<http://www.w3.org/ns/shacl#sparql> [ ] ."),)
""", "extensions: added failed: Unsupported: "),
    "navigation": ("""
        navigation = ("x",)
""", "extensions: added failed: TypeError: navigation has NavigationEntry objects"),
    "kind without handler": ("""
        kinds = (file("kinds.ttl", KIND),)
""", "extensions: the action open failed: LookupError: no Mount.handlers has https://example.org/Open"),
    "metric": (START + """
            yield Mount(metrics=lambda: ["no metric"])
""", "metrics: added failed: TypeError: a metric comes from counter, gauge or gauges"),
    "template": ("""
        def views(self):
            made = file("bad.html", "{% nothing %}")
            return (PageView(NamedNode("https://example.org/X"), made, lambda facts, iri: Part()),)
""", "pages: views of added failed: TemplateSyntaxError"),
    "guard that is not announced": (START + """
            yield Mount(guard=object())
""", "does not say so in guards_motions"),
}  # fmt: skip


@contextmanager
def serving(folder: Path, rest: str) -> Iterator[Browser]:
    """Run a gateway with an extension that consists of ``HEAD`` and ``rest``, and a robot."""
    place = Place(folder / "state")
    with installed(folder, "added", HEAD + rest), process(*place.command(), "--extensions", "added") as one:
        one.said("serving")
        with place.ur5():
            browser = Browser(place.root)
            live(browser, "ur5")
            yield browser
            browser.close()
    sys.modules.pop("added_extension", None)


@pytest.mark.parametrize("fault", FAULTY)
def test_a_faulty_part_of_an_extension_is_left_out_and_named(tmp_path: Path, fault: str) -> None:
    rest, words = FAULTY[fault]
    with serving(tmp_path, rest) as browser:
        for path, accept in (("openapi.json", "application/json"), ("ur5/", "text/html"), ("metrics", "text/plain")):
            answer = browser.http.get(browser.root + path, headers={"accept": accept})
            assert answer.status_code == 200, answer.text
        assert "linked_fleet_robots" in answer.text and "linked_fleet_zenoh_up 1.0" in answer.text
        ready = browser.http.get(browser.root + "health/ready")
        assert ready.status_code == 200
        assert any(words in each for each in ready.json()["warnings"]), ready.text
        faults = browser.page(browser.root).graph.objects(None, LF.fault)
        assert any(words in str(each) for each in faults)
        assert words in browser.http.get(browser.root, headers={"accept": "text/html"}).text.replace("&#39;", "'")
        part = words.partition(": ")[0] if " failed" in words else "extensions"
        assert f'linked_fleet_faults{{part="{part}"}} 1.0' in browser.http.get(browser.root + "metrics").text


def test_motions_are_refused_while_their_guard_is_missing(tmp_path: Path) -> None:
    """Stops are not."""
    rest = "\n        guards_motions = True\n" + FAULTY["start"][0]
    with serving(tmp_path, rest) as browser:
        wrist = browser.part("ur5", "wrist_3_joint")
        body = (
            "<> <http://vocab.arvida.de/2015/06/vom/vocab#numericalValue> 0.1 ; "
            "<http://vocab.arvida.de/2015/06/vom/vocab#unit> <http://qudt.org/vocab/unit/RAD> ."
        )
        fields = {"content-type": "text/turtle", "accept": "application/json"}
        refused = browser.http.post(browser.action(wrist, LF.Rotate), content=body, headers=fields)
        assert (refused.status_code, refused.json()["type"].rpartition("#")[2]) == (503, "unchecked")
        assert "planted" in refused.json()["detail"]
        assert browser.http.post(browser.root + "actions/stopAll").status_code == 204


@pytest.mark.parametrize("hook", ["listening_to_invocations", "listening_to_stops", "listening"])
def test_a_listener_that_raises_prevents_no_motion_and_no_stop(tmp_path: Path, hook: str) -> None:
    rest = (
        START
        + f"""
            with core.{hook}(fail):
                yield Mount()
"""
    )
    with serving(tmp_path, rest) as browser:
        wrist = browser.part("ur5", "wrist_3_joint")
        body = {"value": 0.1, "unit": "http://qudt.org/vocab/unit/RAD"}
        moved = browser.http.post(browser.action(wrist, LF.Rotate), json=body, headers={"prefer": "wait=10"})
        assert moved.status_code == 204, moved.text
        assert browser.page(moved.headers["location"]).one(LF.state) == LF.succeeded
        for stop in ("ur5/actions/stop", "actions/stopAll"):
            assert browser.http.post(browser.root + stop).status_code == 204
        warnings = browser.http.get(browser.root + "health/ready").json()["warnings"]
        assert any("listeners: added_extension.fail failed: RuntimeError: planted" in each for each in warnings)


def test_a_member_that_cannot_be_described_hides_no_other_and_no_query(tmp_path: Path) -> None:
    rest = (
        START
        + """
            def describe(graph, member):
                if member.record == "bad":
                    raise RuntimeError("planted")

            async with core.open_container("notes", str, lambda table: Container(
                segment="~notes", title="Notes", type=NamedNode("https://example.org/Notes"),
                member_type=NamedNode("https://example.org/Note"), records=table,
                shape=NamedNode("https://example.org/NoteInput"), describe=describe, title_of=str,
                read=lambda body: body.text(body.root, DCTERMS.title),
            ), most=2) as notes:
                yield Mount(branches=(notes.branch,))
        at_root = ("~notes",)
        shapes = (file("note.ttl", NOTE),)
"""
    )
    with serving(tmp_path, rest) as browser:
        for title in ("good", "bad"):
            assert browser.http.post(browser.root + "~notes", json={"title": title}).status_code == 201
        full = browser.http.post(browser.root + "~notes", json={"title": "another"})
        assert full.status_code == 409 and "at most 2" in full.text
        listed = browser.http.get(browser.root + "~notes", headers={"accept": "text/turtle"})
        assert listed.status_code == 200 and "good" in listed.text
        query = (
            "SELECT (COUNT(*) AS ?n) { ?note a <https://example.org/Note> ; <http://purl.org/dc/terms/title> ?title }"
        )
        answer = browser.http.get(browser.root + "query", params={"query": query}, headers={"accept": "text/csv"})
        assert answer.text.split() == ["n", "2"], "each statement is there once"
        warnings = browser.http.get(browser.root + "health/ready").json()["warnings"]
        assert any("/~notes: description of " in each and "planted" in each for each in warnings)


def test_no_extension_guards_motions_without_saying_so() -> None:
    assert Extension.guards_motions is False
