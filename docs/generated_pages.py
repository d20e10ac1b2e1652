"""Reference pages generated from the code: HTTP, commands, terms, errors, the Python API."""

import inspect
from collections.abc import Callable, Iterable, Mapping
from importlib.resources import files

import click
from http_reference import http
from pyoxigraph import Literal, NamedNode, RdfFormat, Store, parse

import linked_fleet_shapes
from linked_fleet_base.errors import PROBLEMS, FleetError
from linked_fleet_client.cli import programs
from linked_fleet_client.cli.main import cli
from linked_fleet_gateway import api as contract
from linked_fleet_gateway import faces, serving
from linked_fleet_gateway.app.extensions import BUILT_IN
from linked_fleet_gateway.extensions.openapi import api as openapi
from linked_fleet_gateway.extensions.pages import api as pages

_RDF_TYPE = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
_RDFS = "http://www.w3.org/2000/01/rdf-schema#"
_TERMS = "https://w3id.org/linked-fleet#"
_ENGLISH = (None, "en")
"""Languages of texts for these pages, which are in English."""


def contract_modules() -> tuple[str, ...]:
    """Return the modules that define the names of the contract of extensions."""
    values = (getattr(each, name) for each in (contract, faces, serving, pages, openapi) for name in each.__all__)
    found = {str(getattr(each, "__module__", "")) for each in values}
    return tuple(sorted(each for each in found if each.startswith("linked_fleet_")))


_API = {
    "The client": ("linked_fleet_client.fleet", "linked_fleet_client.thing", "linked_fleet_client.mission",
                   "linked_fleet_client.reading", "linked_fleet_client.quantity", "linked_fleet_client.live",
                   "linked_fleet_client.action", "linked_fleet_client.form", "linked_fleet_client.invocation",
                   "linked_fleet_client.errors"),
    "Drivers of robots": ("linked_fleet_agent.robot", "linked_fleet_agent.agent", "linked_fleet_agent.serving",
                          "linked_fleet_agent.settings", "linked_fleet_agent.mesh_files", "linked_fleet_agent.urdf",
                          "linked_fleet_agent.components", "linked_fleet_agent.components.component",
                          "linked_fleet_agent.components.call", "linked_fleet_agent.components.schemas",
                          "linked_fleet_agent.components.kinds", "linked_fleet_agent.components.driving",
                          "linked_fleet_agent.components.path_following", "linked_fleet_agent.path_tracking",
                          "linked_fleet_agent.planar", "linked_fleet_agent.robots.of_components"),
    "Extensions of gateways": contract_modules(),
}  # fmt: skip


def vocabulary() -> str:
    """Return a table of the vocabulary's terms."""
    store = Store()
    store.extend(parse_terms())
    rows = []
    for iri in sorted({str(each.subject.value) for each in store if _is_term(each.subject)}):
        term = NamedNode(iri)
        kinds = ", ".join(_local(each.object.value) for each in store.quads_for_pattern(term, _RDF_TYPE, None, None))
        rows.append((f"`lf:{_local(iri)}`", kinds, _text(store, term, "label"), _text(store, term, "comment")))
    return (
        "# Vocabulary\n\nThe prefix `lf:` is `" + _TERMS + "`. A gateway serves these terms at `/vocabulary`.\n\n"
        + _table(("term", "type", "label", "meaning"), rows)
    )  # fmt: skip


def parse_terms() -> Iterable[object]:
    """Return the statements of the vocabulary, including those of extensions."""
    for file in (files(linked_fleet_shapes) / "vocabulary.ttl", *(one for each in BUILT_IN for one in each.vocabulary)):
        yield from parse(file.read_bytes(), format=RdfFormat.TURTLE)


def errors() -> str:
    """Return a table of the problem types, including those of extensions, which ``BUILT_IN`` has imported."""
    found = sorted({(each.status, each.code, each.title, _meaning(each)) for each in _below(FleetError)})
    rows = [(str(status), f"`{code}`", title, meaning) for status, code, title, meaning in found]
    return (
        "# Errors\n\nEvery error is a problem document (RFC 9457). Its `type` is `" + PROBLEMS + "` and the code.\n\n"
        + _table(("status", "code", "title", "when"), rows)
    )  # fmt: skip


def api() -> str:
    """Return the page that mkdocstrings fills with the public names of these modules."""
    parts = ["# Python API\n"]
    for title, modules in _API.items():
        parts += [f"## {title}\n", *(f"::: {module}\n" for module in modules)]
    return "\n".join(parts)


def commands() -> str:
    """Return the help of ``linked-fleet`` and of each command of the client."""
    context = cli.make_context("linked-fleet", [], resilient_parsing=True, terminal_width=100)
    parts = ["# Command line\n", _help(cli, context)]
    parts += ["The options of `gateway`, `agent`, `demo` and `doctor` are [settings](SETTINGS.md).\n"]
    for name in sorted({*cli.list_commands(context)} - {*programs.names()}):
        if command := cli.get_command(context, name):
            own = command.make_context(name, [], context, resilient_parsing=True, terminal_width=100)
            parts += [f"## {name}\n", _help(command, own)]
    return "\n".join(parts)


def _help(command: click.Command, context: click.Context) -> str:
    return f"```text\n{command.get_help(context)}\n```\n"


PAGES: Mapping[str, Callable[[], str]] = {
    "http.md": http, "commands.md": commands, "vocabulary.md": vocabulary, "errors.md": errors, "api.md": api,
}  # fmt: skip
"""The generated pages by their paths on the site."""


def _below(kind: type[FleetError]) -> Iterable[type[FleetError]]:
    for each in kind.__subclasses__():
        yield each
        yield from _below(each)


def _meaning(kind: type) -> str:
    """Return the first paragraph of the docstring, and those that name fields of the problem."""
    first, *others = (inspect.getdoc(kind) or "").split("\n\n") if kind.__doc__ else [""]
    return " ".join(" ".join([first, *(each for each in others if "``" in each)]).split())


def _is_term(subject: object) -> bool:
    return isinstance(subject, NamedNode) and subject.value.startswith(_TERMS)


def _local(iri: str) -> str:
    return iri.replace("/", "#").rpartition("#")[2]


def _text(store: Store, term: NamedNode, name: str) -> str:
    found = (each.object for each in store.quads_for_pattern(term, NamedNode(_RDFS + name), None, None))
    return next((each.value for each in found if isinstance(each, Literal) and each.language in _ENGLISH), "")


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(each.replace("|", "\\|") for each in row) + " |" for row in (head, *rows)]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]]) + "\n"
