"""Missions: parameters, and a tree of steps. Pure values; their JSON is that of clients and of the store."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

MOST_STEPS, MOST_DEEP, MOST_PARAMETERS = 200, 16, 32
MOST_ROUNDS = 1000
_DAY_S = 86_400.0

Name = Annotated[str, Meta(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,63}$")]
Text = Annotated[str, Meta(max_length=4096)]
Seconds = Annotated[float, Meta(ge=0, le=30 * _DAY_S)]
Kind = Literal["number", "integer", "boolean", "text", "iri"]


class Parameter(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A value that the client who runs the mission gives. Numbers have no unit: the bodies of steps state it.

    ``options`` are the texts or IRIs that it may have; any if there are none. Without ``default`` it is required.
    """

    name: Name
    type: Kind
    title: Text = ""
    minimum: float | None = None
    maximum: float | None = None
    default: int | float | bool | Text | None = None
    options: tuple[Text, ...] = ()


class _Step(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, tag_field="type", kw_only=True):
    """A step. ``name`` is unique in its mission, if it has one; other steps refer to its result by it."""

    name: Name | Literal[""] = ""
    title: Annotated[str, Meta(max_length=200)] = ""


class Variable(Struct, frozen=True, forbid_unknown_fields=True):
    """Stands for the value of a parameter, or for ``step.member``: a member of the result of an earlier step."""

    variable: Annotated[str, Meta(pattern=r"^[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)?$", max_length=130)]


class Invoke(_Step, tag="invoke", frozen=True):
    """Invokes an action: the one with the IRI ``action``, or that of a ``kind`` at the thing ``of``.

    ``body`` is the action's input in plain JSON, in which ``{"variable": "name"}`` stands for a value. ``triples`` is
    the input as N-Triples about ``_:body`` instead, in which a node with ``lf:variable`` does so.
    """

    action: Text = ""
    kind: Text = ""
    of: Variable | Text = ""
    body: dict[str, Any] | None = None
    triples: Annotated[str, Meta(max_length=32_768)] = ""


class Sequence(_Step, tag="sequence", frozen=True):
    """Runs steps one after the other. The first one that fails ends it."""

    steps: Annotated[tuple["Step", ...], Meta(min_length=1, max_length=MOST_STEPS)]


class Parallel(_Step, tag="parallel", frozen=True):
    """Runs steps at the same time. It succeeds with all of them, or if ``anySuffices`` with the first one."""

    steps: Annotated[tuple["Step", ...], Meta(min_length=1, max_length=MOST_STEPS)]
    anySuffices: bool = False  # noqa: N815


class FirstOf(_Step, tag="firstOf", frozen=True):
    """Tries steps one after the other, until one succeeds."""

    steps: Annotated[tuple["Step", ...], Meta(min_length=1, max_length=MOST_STEPS)]


class Repeat(_Step, tag="repeat", frozen=True):
    """Runs a step so many times, one after the other."""

    step: "Step"
    times: Annotated[int, Meta(ge=1, le=MOST_ROUNDS)]


class Wait(_Step, tag="wait", frozen=True):
    """Waits for ``seconds``, until the instant ``until`` (xsd:dateTime), or until ``condition`` has an answer.

    The condition is a SPARQL SELECT, as of rules. If it has none ``within`` seconds, the step fails.
    """

    seconds: Seconds | None = None
    until: Annotated[str, Meta(max_length=40)] = ""
    condition: Text = ""
    within: Seconds = 3600.0


class Confirm(_Step, tag="confirm", frozen=True):
    """Waits until a person confirms what ``text`` asks."""

    text: Text


class Notify(_Step, tag="notify", frozen=True):
    """Tells everybody who watches the run."""

    text: Text


Step = Invoke | Sequence | Parallel | FirstOf | Repeat | Wait | Confirm | Notify
Branch = Sequence | Parallel | FirstOf
TAGS: Mapping[type, str] = {
    Invoke: "invoke", Sequence: "sequence", Parallel: "parallel", FirstOf: "firstOf", Repeat: "repeat", Wait: "wait",
    Confirm: "confirm", Notify: "notify",
}  # fmt: skip
"""The type of each kind of step in JSON."""


class Mission(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A mission. With ``holds``, a step that fails lets the run wait for a person, instead of ending it."""

    title: Annotated[str, Meta(min_length=1, max_length=200)]
    step: Step
    parameters: Annotated[tuple[Parameter, ...], Meta(max_length=MOST_PARAMETERS)] = ()
    holds: bool = False


def children(step: Step) -> tuple[Step, ...]:
    """Return the steps directly below a step."""
    if isinstance(step, Repeat):
        return (step.step,)
    return step.steps if isinstance(step, Branch) else ()


def walk(step: Step, depth: int = 0) -> Iterator[tuple[Step, int]]:
    """Yield a step and all steps below it, with their depths."""
    yield step, depth
    for each in children(step):
        yield from walk(each, depth + 1)


def walk_paths(step: Step, path: str = "0") -> Iterator[tuple[str, Step]]:
    """Yield a step and all steps below it, with their paths."""
    yield path, step
    for number, each in enumerate(children(step)):
        yield from walk_paths(each, f"{path}.{number}")


def step_at(root: Step, path: str) -> Step:
    """Return the step at a path, such as ``0.2#3.1``: the numbers of children, and of rounds after ``#``."""
    step = root
    for part in path.split(".")[1:]:
        number = part.partition("#")[0]
        step = children(step)[int(number)]
    return step
