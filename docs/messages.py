"""Lists the messages of pages that an extension has, and those that its catalogue of a language lacks.

``python docs/messages.py`` names the missing ones of all extensions; ``--add`` adds them to the files, without a text.
"""

import ast
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from pyoxigraph import Literal, NamedNode, RdfFormat, parse

from linked_fleet_gateway.api import DCTERMS, RDFS
from linked_fleet_gateway.extensions.pages.templating import messages_of

ROOT = Path(__file__).parents[1]
EXTENSIONS = ROOT / "gateway" / "linked_fleet_gateway" / "extensions"
SHAPES = ROOT / "shapes" / "linked_fleet_shapes"
_SAYING = {"say", "message", "translated", "sentence"}
_TITLED = {"NavigationEntry": 0, "Resource": 1}
"""Calls whose argument at this place is the title of something of the gateway."""
_IN_SCRIPT = re.compile(r"""(?<![\w.$])(?:say|message)\(\s*("(?:[^"\\]|\\.)*")""")
_DESCRIPTION = NamedNode("http://www.w3.org/ns/shacl#description")
_ACTION_KIND = NamedNode("https://w3id.org/linked-fleet#ActionKind")
_OF_ACTIONS = {DCTERMS.title, RDFS.comment}


def messages(extension: Path) -> set[str]:
    """Return the messages of the templates, modules, scripts and shapes of an extension."""
    found = set[str]()
    for path in (extension / "templates").glob("*.html"):
        found |= messages_of(path.read_text(encoding="utf-8"))
    for path in (*extension.glob("*.py"), *(_core() if extension.name == "pages" else ())):
        found |= set(_in_module(ast.parse(path.read_text(encoding="utf-8"))))
    for path in scripts(extension):
        found |= {json.loads(each) for each in _IN_SCRIPT.findall(path.read_text(encoding="utf-8"))}
    for path in extension.glob("*.ttl") if extension.name != "pages" else SHAPES.rglob("*.ttl"):
        found |= set(_in_turtle(path))
    return {each for each in found if any(char.isalpha() for char in each)}


def _core() -> Iterator[Path]:
    """Yield the modules that are of no extension, whose refusals the pages say."""
    for package in EXTENSIONS.parents[1].glob("linked_fleet_*"):
        yield from (path for path in package.rglob("*.py") if EXTENSIONS not in path.parents)


def scripts(extension: Path) -> Iterator[Path]:
    folder = extension / "scripts"
    yield from (folder / "src" if (folder / "src").is_dir() else folder).glob("*.js")


def _in_module(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign | ast.AnnAssign):
            yield from _title_of_error(node)
        if not isinstance(node, ast.Call):
            continue
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        place = 0 if name in _SAYING else _TITLED.get(name)
        if place is not None and place < len(node.args):
            yield from _texts(node.args[place])
        if name == "Container":
            yield from (text for each in node.keywords if each.arg == "title" for text in _texts(each.value))


def _title_of_error(node: ast.Assign | ast.AnnAssign) -> Iterator[str]:
    """Yield the title in ``status, code, title = 404, "not-found", "There is no such resource"``."""
    (target, *_) = node.targets if isinstance(node, ast.Assign) else [node.target]
    if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
        names = [each.id for each in target.elts if isinstance(each, ast.Name)]
        if {"status", "title"} <= set(names):
            yield from _texts(node.value.elts[names.index("title")])


def _texts(node: ast.expr) -> Iterator[str]:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value


def _in_turtle(path: Path) -> Iterator[str]:
    triples = list(parse(path.read_bytes(), format=RdfFormat.TURTLE, base_iri="http://localhost/"))
    kinds = {each.subject for each in triples if each.object == _ACTION_KIND}
    in_languages = {(each.subject, each.predicate) for each in triples if getattr(each.object, "language", None)}
    for each in triples:
        of_action = each.subject in kinds and each.predicate in _OF_ACTIONS
        has_own = (each.subject, each.predicate) in in_languages  # which needs no catalogue
        if isinstance(each.object, Literal) and (each.predicate == _DESCRIPTION or of_action) and not has_own:
            yield each.object.value


def catalogue(extension: Path, language: str) -> dict[str, str]:
    path = extension / "languages" / f"{language}.json"
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def all_messages() -> dict[Path, set[str]]:
    """Return the messages of each extension that are not those of the pages."""
    pages = EXTENSIONS / "pages"
    shared = messages(pages)
    found = {pages: shared}
    for folder in sorted(EXTENSIONS.iterdir()):
        if (folder / "__init__.py").exists() and folder != pages and (own := messages(folder) - shared):
            found[folder] = own
    return found


def main() -> None:
    shared = catalogue(EXTENSIONS / "pages", "de")
    for folder, said in all_messages().items():
        own = catalogue(folder, "de")
        lacking = sorted(each for each in said if each not in own and each not in shared)
        for each in lacking:
            print(f"{folder.name}: {each}")
        if "--add" in sys.argv and lacking:
            path = folder / "languages" / "de.json"
            path.parent.mkdir(exist_ok=True)
            path.write_text(
                json.dumps(own | dict.fromkeys(lacking, ""), ensure_ascii=False, indent=1, sort_keys=True) + "\n"
            )


if __name__ == "__main__":
    main()
