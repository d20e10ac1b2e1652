"""Accessibility of a page by axe-core: WCAG 2.2, levels A and AA, and good practice."""

from pathlib import Path
from typing import Any, Literal

from playwright.sync_api import Page

_PAGES = Path(__file__).parents[2] / "gateway/linked_fleet_gateway/extensions/pages"
_AXE = _PAGES / "scripts/node_modules/axe-core/axe.min.js"
_TAGS = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")
_RUN = "(values) => axe.run({ resultTypes: ['violations'], runOnly: { type: 'tag', values } })"
SCHEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")


def violations(page: Page) -> list[str]:
    """Return the findings, a line each."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(_AXE.read_text(encoding="utf-8"))
    found: list[dict[str, Any]] = page.evaluate(_RUN, list(_TAGS))["violations"]
    return [f"{each['id']}: {each['help']} at {[node['html'] for node in each['nodes']][:3]}" for each in found]


def violations_in_both_schemes(page: Page) -> list[tuple[str, str]]:
    """Return the findings in light and in dark mode."""
    found = []
    for scheme in SCHEMES:
        page.emulate_media(color_scheme=scheme)
        found += [(scheme, each) for each in violations(page)]
    return found
