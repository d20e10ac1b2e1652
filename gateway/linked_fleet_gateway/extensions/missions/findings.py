"""Findings about a mission: errors that name the steps, and the parts of their bodies that are at fault. Pure."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from pyoxigraph import BlankNode

from linked_fleet_base.errors import Statement
from linked_fleet_gateway.api import FleetError
from linked_fleet_gateway.extensions.missions.mission import Step
from linked_fleet_rdf.vocabulary import SH

Finding = dict[str, str]
_MOST, _MOST_TEXT = 200, 500
_GATEWAY = 500
_RESULT = {SH.resultPath: "path", SH.resultMessage: "message", SH.value: "value"}
_DECODED = re.compile(
    r"(?P<what>.*) - at `\$\.(?:(?P<list>parameters)\[(?P<number>\d+)\]|(?P<root>step))(?P<rest>\S*)`", re.S
)
_MISSING = re.compile(r"Object missing required field `(.*)`")
_WORDS = {
    "float": "a number", "int": "a whole number", "str": "a text", "bool": "true or false", "array": "a list",
    "object": "an object", "null": "nothing",
}  # fmt: skip
_PART = re.compile(r"\.steps\[(\d+)\]|\.(step)(?![A-Za-z])")


class Findings:
    """Collects the errors of steps, so that a client learns of all of them at once."""

    def __init__(self) -> None:
        self._first: FleetError | None = None
        self._all: list[Finding] = []

    @contextmanager
    def at(self, path: str, step: Step) -> Iterator[None]:
        """Collect the error of a step. What the gateway itself cannot do is raised at once."""
        try:
            yield
        except FleetError as error:
            if error.status >= _GATEWAY:
                raise
            located(error, path, step)
            self._first = self._first or error
            self._all += _findings(error)

    @contextmanager
    def at_parameter(self, name: str) -> Iterator[None]:
        """Collect the error of a parameter."""
        try:
            yield
        except FleetError as error:
            self._first = self._first or error
            self._all.append({"parameter": name, "message": error.detail[:_MOST_TEXT]})

    def check(self) -> None:
        """Raise the first error, if there is any, with what is wrong with all steps."""
        if self._first is not None:
            self._first.added["findings"] = self._all[:_MOST]
            raise self._first


def located(error: FleetError, path: str, step: Step) -> None:
    """Add to an error that it is of a step: to its detail, and as findings, unless it names a step already."""
    if "findings" in error.added:
        return
    found = _results(error.report or ()) or [{"message": error.detail[:_MOST_TEXT]}]
    error.added["findings"] = [{"step": path, **each} for each in found]
    error.detail = f"Step {step.title or step.name or path}: {error.detail}"


def finding_of_decoding(message: str) -> list[Finding]:
    """Return the step, or the number of the parameter, at which a mission in JSON does not have the right form."""
    match = _DECODED.fullmatch(message)
    if match is None:
        return []
    what, rest = _in_words(match["what"])[:_MOST_TEXT], match["rest"]
    if match["list"]:
        return [{"parameterNumber": match["number"], "member": rest.lstrip("."), "message": what}]
    path = "0"
    while part := _PART.match(rest):
        path, rest = f"{path}.{part[1] or 0}", rest[part.end() :]
    member = rest.lstrip(".")
    return [{"step": path, "message": what} | ({"member": member} if member else {})]


def _in_words(message: str) -> str:
    """Return a message of the decoder as people read it."""
    if match := _MISSING.fullmatch(message):
        return f"{match[1]} is missing."
    for name, word in _WORDS.items():
        message = message.replace(f"`{name}`", word)
    return message.rstrip(".") + "."


def _findings(error: FleetError) -> list[Finding]:
    found = error.added["findings"]
    assert isinstance(found, list)
    return [each for each in found if isinstance(each, dict)]


def _results(report: Sequence[Statement]) -> list[Finding]:
    """Return the results of a validation report, of which those without a message say nothing."""
    results: dict[object, Finding] = {value: {} for _, predicate, value in report if predicate == SH.result}
    for subject, predicate, value in report:
        if subject in results and predicate in _RESULT and not isinstance(value, BlankNode):
            results[subject].setdefault(_RESULT[predicate], value.value[:_MOST_TEXT])
    return [each for each in results.values() if "message" in each]
