"""The documentation site builds without a broken link, and contains every page of the repository."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from linked_fleet_gateway import api, faces, serving
from linked_fleet_gateway.extensions.openapi import api as openapi
from linked_fleet_gateway.extensions.pages import api as pages
from running import ROOT

pytestmark = pytest.mark.test_all
_WORDS_OF_README = 500
_APART = re.compile(r"\.github/(?!SECURITY)")
"""Pages for developers, at the places where forges look for them."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the built site. A strict build fails if a link, an anchor or a page in the navigation does not exist."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "-q", "--strict", "-d", str(folder)],
        cwd=ROOT, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_site_has_every_page(site: Path) -> None:
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        from site_hooks import OUTSIDE
    finally:
        sys.path.pop(0)
    listing = ["git", "ls-files", "-co", "--exclude-standard", "*.md"]
    listed = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True)
    pages = [path for path in listed.stdout.split() if not _APART.match(path) and (ROOT / path).exists()]
    assert len(pages) > 30
    for path in pages:
        page = path.removeprefix("docs/") if path.startswith("docs/") else OUTSIDE[path]
        assert page == "index.md" or (site / page.removesuffix(".md") / "index.html").exists(), path


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("http", ["/{robot}/{joint}/actions/rotate", "RotateInput", "assumePose", "…/{property}/blueprint"]),
        ("commands", ["linked-fleet do", "--dry-run", "doctor", "--earl"]),
        ("vocabulary", ["lf:Fleet", "The root of the hierarchy"]),
        ("errors", ["too-many-requests", "out-of-reach", "collision", "<code>share</code>"]),
        ("api", ["linked_fleet_client.fleet", "Mount", "quantity"]),
        ("SETTINGS", ["LINKED_FLEET_EXTENSIONS"]),
    ],
)
def test_reference_is_generated_from_the_code(site: Path, page: str, words: list[str]) -> None:
    text = (site / page / "index.html").read_text()
    assert [word for word in words if word not in text] == []


def test_the_python_api_has_every_module_of_the_contract_of_extensions_and_of_the_examples(site: Path) -> None:
    values = (getattr(each, name) for each in (api, faces, serving, pages, openapi) for name in each.__all__)
    named = {str(getattr(each, "__module__", "")) for each in values}
    named = {each for each in named if each.startswith("linked_fleet_gateway.")}
    for example in (ROOT / "examples").glob("*.py"):
        named |= set(re.findall(r"^from (linked_fleet_\w+\.[\w.]+) import", example.read_text(), re.M))
    assert len(named) > 12
    text = (site / "api" / "index.html").read_text()
    assert [name for name in sorted(named) if f'id="{name}"' not in text] == []


def test_each_error_says_when_it_occurs(site: Path) -> None:
    rows = re.findall(r"<tr>\s*((?:<td>.*?</td>\s*)+)</tr>", (site / "errors" / "index.html").read_text(), re.S)
    assert len(rows) > 30
    assert [row for row in rows if "<td></td>" in row] == []


def test_the_map_leads_to_every_page_but_the_contributors_and_the_generated(site: Path) -> None:
    there = {page.parent.name for page in site.glob("*/index.html")} - {"MAP", "TUTORIAL", "changelog", "contributing"}
    led = set(re.findall(r'href="\.\./([\w-]+)/', (site / "MAP" / "index.html").read_text().partition("<article")[2]))
    assert there - led == {"http", "commands", "vocabulary", "errors", "api"}


def test_nothing_is_loaded_from_another_host(site: Path) -> None:
    loaded = re.compile(
        r"<(?:script|img|iframe|source)[^>]*\ssrc=\"https?:|<link[^>]*rel=\"(?:stylesheet|preload)\"[^>]*href=\"https?:"
    )
    assert [page for page in site.rglob("*.html") if loaded.search(page.read_text())] == []


def test_the_front_page_is_short() -> None:
    assert len((ROOT / "README.md").read_text().split()) <= _WORDS_OF_README
