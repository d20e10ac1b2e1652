"""The blocks of shapes/README.md, put where it says, add an action to each joint with limits."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from pyoxigraph import NamedNode, Triple

from linked_fleet_agent.wire.messages import Move
from linked_fleet_base.contributions import using
from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.actions import action_handlers as handlers
from linked_fleet_gateway.app.extensions import BUILT_IN, contributions_of
from linked_fleet_gateway.resources.shape_parameters import COMPLETIONS
from linked_fleet_rdf import shapes
from linked_fleet_rdf.validation import ShaclValidator
from linked_fleet_rdf.vocabulary import HYBRIT, LF

_ROOT = Path(__file__).parents[3]
_README = (_ROOT / "shapes" / "README.md").read_text(encoding="utf-8")
_CENTRE = NamedNode("https://example.org/actions#Centre")
_LIMIT = '<limit lower="-1" upper="2" velocity="1" effort="1"/>'
_JOINTS = {
    "elbow": ("revolute", _LIMIT),
    "lift": ("prismatic", _LIMIT),
    "wheel": ("continuous", ""),
    "free": ("revolute", ""),
    "finger": ("revolute", _LIMIT + '<mimic joint="elbow"/>'),
}


def _blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", _README, re.MULTILINE | re.DOTALL)


def _forget() -> None:
    for each in (shapes._load, shapes.load_turtle_file):
        each.cache_clear()


@pytest.fixture
def extended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Copy shapes/ and add the file of step 1, the module of step 2 and the line of step 3."""
    folder = tmp_path / "linked_fleet_shapes"
    shutil.copytree(_ROOT / "shapes" / "linked_fleet_shapes", folder)
    (turtle,) = _blocks("turtle")
    (folder / "actions" / "centre.ttl").write_text(turtle, encoding="utf-8")
    module, line = _blocks("python")
    centre = ModuleType("centre")
    exec(module, vars(centre))
    monkeypatch.setattr(shapes, "resources", SimpleNamespace(files=lambda package: folder))
    for kind, handler in eval("{" + line + "}", {**vars(handlers), "centre": centre}).items():
        monkeypatch.setitem(handlers.HANDLERS, kind, handler)
    _forget()
    with using(contributions_of(BUILT_IN)):
        yield
    monkeypatch.undo()
    _forget()


def _body() -> str:
    (request,) = _blocks("http")
    return request.partition("\n\n")[2]


def test_things_offer_the_new_action(bench: Any, extended: None) -> None:
    """Things admitted by the file and the handler offer it, linked and described like every action."""
    bench.robot(_JOINTS)
    for joint in _JOINTS:
        linked = {t.object for t in bench.described(f"/r/{joint}").triples if t.predicate == HYBRIT.action}
        path = f"/r/{joint}/actions/centre"
        assert (NamedNode(bench.base + path) in linked) == (joint in ("elbow", "lift")), joint
        assert (bench.resource(path) is not None) == (joint in ("elbow", "lift")), joint
    bench.robot(_JOINTS, capabilities=("stop",))
    assert bench.resource("/r/elbow/actions/centre") is None


def test_its_description_conforms(bench: Any, extended: None) -> None:
    """To the blueprint of actions, with both methods and the usual container of invocations."""
    bench.robot(_JOINTS)
    path = "/r/elbow/actions/centre"
    blueprints = [triple for about in shapes.load_turtle("blueprints.ttl").values() for triple in about]
    description = bench.described(path).triples
    iri = NamedNode(bench.base + path)
    assert ShaclValidator(blueprints, LF.ActionShape).report(description, iri) is None
    assert bench.offer(path).methods == ("POST", "PUT")
    assert bench.offer(path).definition.iri == _CENTRE
    assert Triple(iri, LF.invocations, NamedNode(f"{iri.value}/invocations")) in description
    assert bench.resource(path + "/invocations") is not None
    assert bench.described(path + "/produceshape").triples


def test_the_new_action_is_planned(bench: Any, extended: None) -> None:
    """The page's request moves the joint to the middle, no faster than the robot permits."""
    bench.robot(_JOINTS)
    for joint in ("elbow", "lift"):
        plan = bench.plan(f"/r/{joint}/actions/centre", _body())
        assert (plan.motion, plan.targets, plan.speed_scale) == (Move({joint: 0.5}), {joint: 0.5}, 0.5)
    bench.fleet.configure("r", {"maximumSpeedScale": "0.25"})
    assert bench.plan("/r/elbow/actions/centre", _body()).speed_scale == 0.25


@pytest.mark.parametrize("scale", ["", "0", "1.1", '"0.5"', "0.5, 0.6", "true"])
def test_its_shape_guards(bench: Any, extended: None, scale: str) -> None:
    """By the rule of an option shared with other actions, and by its own rule that makes it mandatory."""
    bench.robot(_JOINTS)
    said = f"<> lf:speedScale {scale} ." if scale else "<> lf:reason 'none' ."
    with pytest.raises(UnprocessableContent) as caught:
        bench.plan("/r/elbow/actions/centre", said)
    assert caught.value.report


def test_the_action_is_gone_with_its_file(bench: Any) -> None:
    """The tests above remove what they add."""
    bench.robot(_JOINTS)
    assert bench.resource("/r/elbow/actions/centre") is None
    assert _CENTRE not in handlers.HANDLERS


def test_the_page_names_all_completions_and_files_that_there_are() -> None:
    """Neither more nor fewer completions; paths exist, except those that the reader creates."""
    table = _README.partition("| `lf:completedBy` | adds |\n")[2].partition("\n\n")[0]
    assert {LF.terms[each] for each in re.findall(r"^\| `lf:(\w+)` \|", table, re.MULTILINE)} == set(COMPLETIONS)
    named = set(re.findall(r"`((?:gateway|shapes|tests)/[\w/.]+)`", _README))
    missing = {each for each in named if not (_ROOT / each).exists()}
    assert missing == {
        "shapes/linked_fleet_shapes/actions/centre.ttl",
        "gateway/linked_fleet_gateway/actions/centre.py",
    }
    files = re.findall(r"^\| `([\w/]+\.ttl)`", _README, re.MULTILINE)
    assert all((_ROOT / "shapes" / "linked_fleet_shapes" / each).exists() for each in files)
