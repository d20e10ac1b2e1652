"""A gateway whose shapes cannot be compiled does not start, and says which one and why."""

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from linked_fleet_base.contributions import using
from linked_fleet_gateway.app.application import _check_all, check_shapes, create_app
from linked_fleet_gateway.app.extensions import BUILT_IN, contributions_of
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.http.extension import Extension
from linked_fleet_rdf import shapes
from linked_fleet_shacl import Unsupported

_SHAPES = Path(__file__).parents[3] / "shapes" / "linked_fleet_shapes"
Change = Callable[[str, str, str], None]


@pytest.fixture
def change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Change]:
    """Change a file in a copy of shapes/, which is used instead."""
    folder = Path(shutil.copytree(_SHAPES, tmp_path / "linked_fleet_shapes"))

    def forget() -> None:
        for each in (shapes._load, shapes.load_turtle_file, _check_all):
            each.cache_clear()

    def changed(name: str, old: str, new: str) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))
        forget()

    monkeypatch.setattr(shapes, "resources", SimpleNamespace(files=lambda package: folder))
    forget()
    yield changed
    monkeypatch.undo()
    forget()


@pytest.mark.parametrize(
    ("name", "old", "new", "reason"),
    [
        ("blueprints.ttl", "lf:TextInput a sh:NodeShape ;", "lf:TextInput a sh:NodeShape ; sh:lessThan lf:value ;",
         "shapes/blueprints.ttl: <https://w3id.org/linked-fleet#TextPropertyShape> cannot be compiled: sh:lessThan"),
        ("subscriptions.ttl", "sh:targetClass hybrit:WebCallback ;", "sh:node lf:WebCallbackShape ;",
         "WebCallbackShape> cannot be compiled: <https://w3id.org/linked-fleet#WebCallbackShape> refers to itself"),
        ("actions/rotate.ttl", "sh:NodeShape", "sh:NodeShape ; sh:minInclusive 'low'",
         "shapes/actions/rotate: <https://w3id.org/linked-fleet#RotateInput> cannot be compiled: sh:minInclusive"),
        ("actions/rotate.ttl", "lf:completedBy lf:jointPosition", "lf:completedBy lf:jointPositon",
         "lf:completedBy <https://w3id.org/linked-fleet#jointPositon> is not known"),
    ],
)  # fmt: skip
def test_a_shape_that_cannot_be_compiled_is_refused_at_the_start(
    change: Change, name: str, old: str, new: str, reason: str
) -> None:
    change(name, old, new)
    with pytest.raises(Unsupported, match=re.escape(reason)):
        create_app(GatewaySettings())


def test_the_shapes_that_there_are_are_compiled() -> None:
    _check_all.cache_clear()
    check_shapes()


def test_a_shape_of_an_extension_that_cannot_be_compiled_is_refused_with_its_reason(tmp_path: Path) -> None:
    file = tmp_path / "shapes.ttl"
    file.write_text(
        "@prefix sh: <http://www.w3.org/ns/shacl#> . <http://e.example/Bad> a sh:NodeShape ; sh:sparql [ ] ."
    )

    class Gripper(Extension):
        name, shapes = "gripper", (file,)

    reason = re.escape("<http://e.example/Bad> cannot be compiled: sh:sparql")
    with using(contributions_of([*BUILT_IN, Gripper()])), pytest.raises(Unsupported, match=reason):
        check_shapes()
