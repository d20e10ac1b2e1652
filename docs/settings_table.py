"""Writes the table of docs/SETTINGS.md from the settings classes: ``make docs-settings``."""

import re
from collections.abc import Iterator
from pathlib import Path

from linked_fleet_agent.settings import SETTINGS
from linked_fleet_base.settings import Section
from linked_fleet_gateway.app.extensions import BUILT_IN, ExtensionSettings
from linked_fleet_gateway.app.settings import GatewaySettings

PAGE = Path(__file__).with_name("SETTINGS.md")
_HEAD = "| process | variable | flag | default | meaning |\n|---|---|---|---|---|\n"


def sections() -> list[tuple[str, type[Section]]]:
    """Return the sections of a gateway and of all built-in extensions, each with the process that reads it."""
    extensions = ((f"gateway, {each.name}", each.settings) for each in BUILT_IN if each.settings)
    return [("gateway", GatewaySettings), ("gateway", ExtensionSettings), *extensions]


def table() -> str:
    return _HEAD + "".join(_rows())


def page(text: str) -> str:
    """Return the page with the current table; ``text`` is the existing page."""
    return text.partition(_HEAD)[0] + table()


def _rows() -> Iterator[str]:
    for process, section in sections():
        for each in section.settings():
            yield _row(process, each.variable, each.flag, each.default, each.meaning)
    for setting in SETTINGS:
        yield _row("agents", setting.variable, setting.flag, setting.default, setting.meaning)


def _row(process: str, variable: str, flag: str, default: str, meaning: str) -> str:
    value = f" `{default}` " if default else " "
    return f"| {process} | `{variable}` | `{flag}` |{value}| {_linked(meaning)} |\n"


def _linked(text: str) -> str:
    """Turn paths of pages into links from this page."""
    text = re.sub(r"\bdocs/(\w+\.md(?:#[\w-]+)?)", r"[how](\1)", text)
    return re.sub(r"\b(deploy/README\.md#[\w-]+)", r"[how](../\1)", text)


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text()))
