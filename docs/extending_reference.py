"""Writes the reference of docs/EXTENDING.md from the contract of extensions: ``make docs-extending``."""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from types import GenericAlias
from typing import Any

from linked_fleet_gateway import api, faces, serving
from linked_fleet_gateway.extensions.openapi import api as openapi
from linked_fleet_gateway.extensions.pages import api as pages

_CHOSEN = {
    "Robot": {
        "name": "",
        "title": "",
        "online": "True if its agent is present.",
        "presence": "`online`, `offline` or `faulty`.",
        "fault": "",
        "model": "The `RobotModel` of its URDF; None without a usable description.",
        "description": "What the agent says about it; None before.",
        "positions": "",
        "annotations": "Statements about it and its parts, by the agent and by clients.",
        "settings": "Values that clients have set, by name.",
        "speed_scale": "",
        "last_seen_ns": "",
        "link_pose": "",
        "pose_between": "",
    },
    "Resource": dict.fromkeys(
        ("path", "title", "describe", "interaction_model", "source", "own_paths", "part_paths", "typed_links",
         "affords", "documents", "remote", "immutable",
         "publishes_changes", "replace", "full_graph"), "",
    ),
    "Identities": {
        "roster": "The contents of the file of identities.", "bearer": "", "identity_of": "", "keys": "", "verify": "",
        "web": "HTTP requests to issuers.", "end_revoked": "",
    },
    "Live": {
        "fleet": "The state of all robots.",
        "invocations": "The invocations of all gateways.",
        "faults": "Faults of the gateway, and `guard`, which notes them.",
        "branches": "",
        "tree": "",
        "fan_out": "Watched resources: `mark_changed`, `mark_robot_changed`, `add_resource`, listeners to watchers.",
        "link": "The link to agents: `ask_agent`.",
        "meshes": "Meshes of robots, from their agents.",
        "add_listener": "", "remove_listener": "", "add_value_listener": "", "remove_value_listener": "",
        "add_invocation_listener": "", "remove_invocation_listener": "",
    },
    "Offer": dict.fromkeys(
        ("definition", "thing", "robot", "joint", "label", "path", "name", "methods", "takes_body", "is_stop"), ""
    ),
    "Watcher": {"subscription": "Its subscription: `resource`, `media_type`, `interval_s`."},
    "FleetError": dict.fromkeys(("status", "code", "title", "retry_after_s", "member_names"), ""),
    "Request": {
        "base": "The public base URL used by the client, without a slash at its end.",
        "caller_name": "The displayed and counted name of the caller.",
        "tree": "Return the tree as the caller may see it.",
    },
}  # fmt: skip
"""The members of classes that have more than extensions need, with their meanings, if these are not in the code."""
DOORS = (api, faces, serving, pages, openapi)
"""The modules that extensions may import."""
PAGE = Path(__file__).with_name("EXTENDING.md")
HEAD = "## Reference\n"


def page(text: str) -> str:
    """Return the page with the current reference at its end; ``text`` is the existing page."""
    return text.partition(HEAD)[0] + HEAD + "\n" + reference()


def reference() -> str:
    """Return the names of each module of the contract in alphabetical order, with their members."""
    parts = [f"This is version {api.VERSION} of the contract.\n\n"]
    described: dict[str, Any] = {}
    for module in DOORS:
        parts.append(f"### `{module.__name__}`\n\n{_first(inspect.getdoc(module))}\n\n")
        names = sorted((each for each in module.__all__ if each != "VERSION"), key=str.lower)
        constants = [each for each in names if not callable(getattr(module, each))]
        if constants:
            parts.append("Constants: " + ", ".join(f"`{each}`" for each in constants) + ".\n\n")
        parts.append("| name | meaning |\n|---|---|\n")
        for name in names:
            value = getattr(module, name)
            if name not in constants:
                parts += [f"| `{name}` | as above |\n"] if described.get(name) is value else _rows(name, value)
            described.setdefault(name, value)
        parts.append("\n")
    return "".join(parts).rstrip("\n") + "\n"


def _rows(name: str, value: Any) -> Iterator[str]:
    if isinstance(value, GenericAlias):
        yield f"| `{name}` | {_escaped(f'`{value}`')} |\n"
    elif not str(getattr(value, "__module__", "")).startswith("linked_fleet"):
        yield f"| `{name}` | of the package {value.__module__.partition('.')[0]} |\n"
    elif inspect.isclass(value):
        yield f"| **`{name}`** | {_first(inspect.getdoc(value))} |\n"
        yield from (f"| `{name}.{signature}` | {meaning} |\n" for signature, meaning in _chosen(name, value))
    elif inspect.isfunction(value):
        (node,) = _parsed(value)
        assert isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        yield f"| `{name}{_arguments(node)}` | {_first(inspect.getdoc(value))} |\n"
    else:  # an alias of types
        yield f"| `{name}` | {_escaped(f'`{value}`')} |\n"


def _chosen(name: str, cls: type) -> Iterator[tuple[str, str]]:
    if issubclass(cls, Enum):
        yield from ((each.name, f"`{each.value}`") for each in cls)
        return
    found, chosen = list(_members(cls)), _CHOSEN.get(name)
    if chosen is None:
        yield from found
        return
    known = {re.split(r"\W", signature)[0]: (signature, meaning) for signature, meaning in found}
    for member, told in chosen.items():
        signature, meaning = known.get(member, (member, ""))
        yield signature, told or meaning


def _members(cls: type) -> Iterator[tuple[str, str]]:
    (node,) = _parsed(cls)
    assert isinstance(node, ast.ClassDef)
    for at, each in enumerate(node.body):
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name) and not each.target.id.startswith("_"):
            annotation = ast.unparse(each.annotation).strip("'")
            default = (
                "" if each.value is None or "factory" in ast.unparse(each.value) else f" = {ast.unparse(each.value)}"
            )
            yield f"{each.target.id}: {annotation}{default}".replace("|", "\\|"), _first(_text_after(node.body, at))
        elif isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef) and not each.name.startswith("_"):
            is_property = any("property" in ast.unparse(one) for one in each.decorator_list)
            yield each.name + ("" if is_property else _arguments(each)), _first(ast.get_docstring(each))


def _arguments(node: ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    given = node.args
    names = [each.arg for each in given.args if each.arg not in ("self", "cls")]
    names += [f"*{given.vararg.arg}"] if given.vararg else []
    names += [f"{each.arg}=" for each in given.kwonlyargs]
    return f"({', '.join(names)})"


def _text_after(body: list[ast.stmt], at: int) -> str:
    following = body[at + 1] if at + 1 < len(body) else None
    if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
        return str(following.value.value)
    return ""


def _first(text: str | None) -> str:
    """Return the first paragraph of a docstring as one line of Markdown."""
    words = " ".join((text or "").strip().partition("\n\n")[0].split())
    return _escaped(re.sub(r"``([^`]*)``", r"`\1`", words))


def _escaped(text: str) -> str:
    return text.replace("|", "\\|")


def _parsed(value: Any) -> list[ast.stmt]:
    return ast.parse(textwrap.dedent(inspect.getsource(value))).body


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text()))
