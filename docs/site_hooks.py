"""Hooks of MkDocs: pages outside docs/, generated pages, and links between all of them.

MkDocs only knows the folder docs/. Pages beside the code that they describe become pages of the site under the names in
``OUTSIDE``, and links in all pages are rewritten to the site's paths. A link to a file that is not on the site becomes
plain text; one to a missing file stays, so that a strict build fails.
"""

import posixpath
import re
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parent))
import generated_pages

ROOT = Path(__file__).parents[1]
OUTSIDE = {
    "README.md": "index.md",
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    ".github/SECURITY.md": "security.md",
    "agents/README.md": "agents.md",
    "agents/linked_fleet_agent/wire/PROTOCOL.md": "wire.md",
    "bench/README.md": "bench.md",
    "client/CONFORMANCE.md": "conformance.md",
    "client/README.md": "client.md",
    "deploy/README.md": "deploy.md",
    "deploy/helm/README.md": "helm.md",
    "examples/README.md": "examples.md",
    "gateway/linked_fleet_gateway/actions/PROTOCOL.md": "actions.md",
    "gateway/linked_fleet_shacl/CONFORMANCE.md": "shacl.md",
    "gateway/linked_fleet_gateway/subscriptions/PROTOCOL.md": "subscriptions.md",
    "shapes/README.md": "shapes.md",
    "tests/MUTANTS.md": "mutants.md",
    "tests/README.md": "tests.md",
    "tests/support/README.md": "helpers.md",
    "tests/histories/README.md": "histories.md",
    "tests/agents/ros2/peers/README.md": "ros-peers.md",
}
_EXTENSIONS = "gateway/linked_fleet_gateway/extensions"
OUTSIDE |= {
    f"{_EXTENSIONS}/{page.parent.name}/README.md": f"{page.parent.name}.md"
    for page in (ROOT / _EXTENSIONS).glob("*/README.md")
}
"""The page of each extension is named after it."""
_PRESENT = {path: page for path, page in OUTSIDE.items() if (ROOT / path).exists()}
_SOURCES = {page: path for path, page in _PRESENT.items()}
_LINK = re.compile(r"(?P<image>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<target>[^)\s#]*)(?P<fragment>#[^)\s]*)?\)")
_BLOCK = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages outside docs/ and the generated pages."""
    for path, page in _PRESENT.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / path)))
    for page, content in generated_pages.PAGES.items():
        files.append(File.generated(config, page, content=content()))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrite the links of a page, except in code blocks."""
    parts, end = [], 0
    for block in _BLOCK.finditer(markdown):
        parts += [_with_links(markdown[end : block.start()], page.file.src_uri), block[0]]
        end = block.end()
    return "".join([*parts, _with_links(markdown[end:], page.file.src_uri)])


def _with_links(markdown: str, page: str) -> str:
    return _LINK.sub(lambda link: _rewritten(link, page), markdown)


def _rewritten(link: re.Match[str], page: str) -> str:
    target = link["target"]
    if not target or ":" in target:
        return link[0]
    written_in = _SOURCES.get(page, f"docs/{page}")
    path = posixpath.normpath(posixpath.join(posixpath.dirname(written_in), target))
    on_site = _PRESENT.get(path) or (path.removeprefix("docs/") if path.startswith("docs/") else None)
    if on_site is not None:
        return f"{link['image']}[{link['text']}]({on_site}{link['fragment'] or ''})"
    return link["text"] if (ROOT / path).exists() else link[0]
