"""The core tests of the W3C's SHACL suite: each passes or is refused, and pySHACL agrees with those that pass.

``make shacl-suite`` fetches them.
"""

import re
from collections import defaultdict
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import pytest
from pyoxigraph import NamedNode, RdfFormat, Triple, parse

from linked_fleet_shacl import Data, Unsupported, compile_graph
from linked_fleet_shacl.terms import RDF, Namespace, Node, Term
from shacl_findings import pyshacl_reports, reported, results

_ROOT = Path(__file__).parents[2]
_SUITE = _ROOT / "build/shacl-suite/core"
_MF = Namespace("http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#", "action result")
_SHT = Namespace("http://www.w3.org/ns/shacl-test#", "Validate dataGraph shapesGraph")
_FILES = sorted(path.relative_to(_SUITE).as_posix() for path in _SUITE.rglob("*.ttl"))


@cache
def _read(path: Path) -> list[Triple]:
    return [quad.triple for quad in parse(path=str(path), format=RdfFormat.TURTLE, base_iri=path.as_uri())]


def _one(data: Data, subject: Term, predicate: NamedNode) -> Node:
    (found,) = data.objects(subject, predicate)
    return found  # type: ignore[return-value]


class _Test:
    """One ``sht:Validate``: data, shapes and the expected report."""

    def __init__(self, name: str) -> None:
        about = Data(_read(_SUITE / name))
        (test,) = about.subjects(RDF.type, _SHT.Validate)
        action = _one(about, test, _MF.action)
        self.data, self.shapes = (
            _read(Path(unquote(_one(about, action, each).value.removeprefix("file://"))))
            for each in (_SHT.dataGraph, _SHT.shapesGraph)
        )
        self.expected = results(about, _one(about, test, _MF.result))


_TESTS = [name for name in _FILES if any(t.object == _SHT.Validate for t in _read(_SUITE / name))]


def test_the_suite_is_here() -> None:
    assert len(_TESTS) == 98, "make shacl-suite fetches it"


@pytest.mark.parametrize("name", _TESTS)
def test_a_test_is_passed_or_refused(name: str) -> None:
    """Nothing is ever found but what the suite and pySHACL find."""
    test = _Test(name)
    try:
        found = reported(compile_graph(test.shapes), test.data)
    except Unsupported as error:
        assert str(error)
        return
    assert found == test.expected
    assert pyshacl_reports(test.shapes, test.data) == test.expected


def test_the_page_tells_what_is_passed_and_what_is_refused() -> None:
    reasons: dict[str, list[str]] = defaultdict(list)
    for name in _TESTS:
        try:
            compile_graph(_Test(name).shapes)
            reason = ""
        except Unsupported as error:
            reason = str(error)
        reasons[re.sub(r".*/|(-duplicate|-ill-formed)?(-\d+)?\.ttl$", "", name)].append(reason)
    passed, rows = [], []
    for component, found in sorted(reasons.items()):
        refused = list(filter(None, found))
        if refused:
            why = ", ".join(dict.fromkeys(refused))
            rows.append(f"| {component} | {len(found) - len(refused)} | {len(refused)} | {why} |\n")
        else:
            passed.append(f"{component} {len(found)}")
    page = (_ROOT / "gateway/linked_fleet_shacl/CONFORMANCE.md").read_text()
    assert page.endswith("|---|---|---|---|\n" + "".join(rows)), "".join(rows)
    said = f"with their number: {', '.join(passed)}."
    assert said in " ".join(page.split()), said
