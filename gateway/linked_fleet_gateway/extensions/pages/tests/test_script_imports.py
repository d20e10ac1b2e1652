"""Scripts import those of pages and of what their extension needs alone, and styles are those of one extension."""

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


def test_a_class_is_styled_by_one_extension_and_used_by_it() -> None:
    """All styles are one file: a second meaning of a class took the first column out of the table of the fleet."""
    styled, used = dict[str, set[str]](), dict[str, set[str]]()
    for folder in (each for each in EXTENSIONS.iterdir() if (each / "scripts").is_dir()):
        for file in (*folder.glob("scripts/*.css"), *folder.glob("scripts/src/*.css")):
            for heads in re.findall(r"^([^{}@]+)\{", re.sub(r"/\*.*?\*/", "", file.read_text(), flags=re.S), re.M):
                for name in re.findall(r"(?:^|,)\s*\.([a-z][\w-]*)\s*(?=,|$)", heads.strip()):
                    styled.setdefault(name, set()).add(folder.name)
        for file in (*folder.glob("templates/*.html"), *folder.glob("scripts/*.js"), *folder.glob("scripts/src/*.js")):
            for names in re.findall(r"""class(?:Name)?\s*[=:]\s*"([^"{}]*)\"""", file.read_text()):
                for name in names.split():
                    used.setdefault(name, set()).add(folder.name)
    assert {"facts", "replay-bar"} <= styled.keys()
    assert {name: by for name, by in styled.items() if len(by) > 1} == {}
    own = {name: by for name, by in styled.items() if "pages" not in by}
    assert {
        name: used.get(name, by) - by - {"pages"} for name, by in own.items() if used.get(name, by) - by - {"pages"}
    } == {}
