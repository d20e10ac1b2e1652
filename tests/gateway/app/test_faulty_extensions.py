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
    from linked_fleet_gateway.http.extension import Extension, Mount

    def fail(*_):
        raise RuntimeError("planted")

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


def test_no_extension_guards_motions_without_saying_so() -> None:
    assert Extension.guards_motions is False
