"""Accessibility of a page by axe-core: WCAG 2.2, levels A and AA, and good practice."""

from pathlib import Path
from typing import Any, Literal

from playwright.sync_api import Page

_PAGES = Path(__file__).parents[2] / "gateway/linked_fleet_gateway/extensions/pages"
_AXE = _PAGES / "scripts/node_modules/axe-core/axe.min.js"
_TAGS = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")
_OF_COLOURS = ("color-contrast", "link-in-text-block")
"""The rules whose findings depend on the colour scheme."""
_RUN = "([type, values]) => axe.run({ resultTypes: ['violations'], runOnly: { type, values } })"
SCHEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")


def violations(page: Page) -> list[str]:
    """Return the findings, a line each."""
    return _found(page, "tag", _TAGS)


def _found(page: Page, kind: str, values: tuple[str, ...]) -> list[str]:
    if not page.evaluate("'axe' in window"):
        page.evaluate(_AXE.read_text(encoding="utf-8"))
    found: list[dict[str, Any]] = page.evaluate(_RUN, [kind, list(values)])["violations"]
    return [f"{each['id']}: {each['help']} at {[node['html'] for node in each['nodes']][:3]}" for each in found]


def violations_in_both_schemes(page: Page) -> list[tuple[str, str]]:
    """Return the findings in light mode, and those about colours in dark mode."""
    light, dark = SCHEMES
    page.emulate_media(color_scheme=light)
    found = [(light, each) for each in violations(page)]
    page.emulate_media(color_scheme=dark)
    return [*found, *((dark, each) for each in _found(page, "rule", _OF_COLOURS))]
