"""The scripts of pages import those of no extension, and extensions those of pages and of what they need alone."""

import re
from pathlib import Path

from linked_fleet_gateway.app.extensions import BUILT_IN

EXTENSIONS = Path(__file__).parents[2]
PAGES = EXTENSIONS / "pages" / "scripts" / "src"
NEEDED = {each.name: each.needs for each in BUILT_IN}


def _imports(path: Path) -> set[Path]:
    named = re.findall(r"""(?:from|import)\s*\(?\s*["'](\.[^"']+)["']""", path.read_text())
    return {(path.parent / each).resolve() for each in named}


def test_the_scripts_of_pages_import_those_of_no_extension() -> None:
    scripts = list(PAGES.glob("*.js"))
    assert len(scripts) > 30
    assert {each for script in scripts for each in _imports(script) if each.parent != PAGES.resolve()} == set()


def test_the_scripts_of_extensions_import_those_of_pages_and_of_extensions_that_they_need() -> None:
    scripts = list(EXTENSIONS.glob("*/scripts/*.js"))
    assert {"cameras", "history", "world"} <= {script.parts[-3] for script in scripts}
    for script in scripts:
        name = script.parts[-3]
        allowed = {
            PAGES.resolve(),
            *((EXTENSIONS / each / "scripts").resolve() for each in {name, *NEEDED[name]}),
        }
        assert all(each.parent in allowed and each.is_file() for each in _imports(script)), script


def test_every_folder_of_scripts_has_the_module_that_pages_start() -> None:
    folders = {each.parent for each in EXTENSIONS.glob("*/scripts/*.js")}
    for folder in folders:
        assert re.search(r"^export function start\(\)", (folder / "page.js").read_text(), re.M), folder
