"""Definitions of ROS 2 messages, services and actions, and the text that states them (.msg, .srv, .action). Pure.

A service and an action are types too, whose fields are their parts, as in type descriptions (REP 2016).
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

Arity = Literal["one", "array", "bounded", "sequence"]
"""One value, an array of ``size``, a sequence of at most ``size``, a sequence of any length."""

NUMBERS: Mapping[str, str] = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q",
    "float32": "f", "float64": "d", "bool": "?", "byte": "B", "char": "B",
}  # fmt: skip
"""Types of one number, and their codes in ``struct``. A ``char`` of a .msg file is an ``uint8``; others are of IDL."""
TEXTS = ("string", "wstring")
PRIMITIVES = frozenset({*NUMBERS, *TEXTS, "wchar"})

MAX_FIELDS, MAX_NAME, MAX_SIZE, MAX_TEXT = 512, 255, 65_536, 262_144
"""Bounds of one definition: its fields, the length of names, fixed sizes, and the text that states it."""
FILLER = "structure_needs_at_least_one_member"
"""The field that stands in a type without fields, because no type of IDL is empty."""

_NAME = re.compile(r"[a-z][a-z0-9_]*/(msg|srv|action)/[A-Za-z][A-Za-z0-9_]*\Z")
_FIELD_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")
_LINE = re.compile(
    r"(?P<type>[A-Za-z][A-Za-z0-9_/]*)(?:<=(?P<text>[0-9]{1,9}))?(?P<array>\[(?P<upto><=)?(?P<size>[0-9]{0,9})\])?"
    r"\s+(?P<name>[A-Za-z][A-Za-z0-9_]*)\s*(?P<constant>=)?\s*(?P<value>.*)\Z"
)
_QUOTED = re.compile(r""""(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*'""")
_COMMENT = re.compile(r"""((?:[^#"']|"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*'|["'])*?)(#.*)?\Z""")


class DefinitionError(ValueError):
    """A type is not defined, or cannot be used; the message says what is wrong and what would be right."""


@dataclass(frozen=True, slots=True)
class Field:
    """A member of a type. ``type`` is a primitive, or the name of a type such as ``std_msgs/msg/Header``.

    ``text_size`` is the longest text of a bounded string, 0 if it is not bounded. A ``default`` of None is zero.
    """

    name: str
    type: str
    arity: Arity = "one"
    size: int = 0
    text_size: int = 0
    default: Any = None


@dataclass(frozen=True, slots=True)
class Definition:
    """A type by its full name, its fields, and its constants by name."""

    name: str
    fields: tuple[Field, ...]
    constants: tuple[tuple[str, Any], ...] = ()


def check_name(name: str) -> str:
    """Return the name. Raises DefinitionError if it is not that of a type."""
    if len(name) > MAX_NAME or not _NAME.match(name):
        raise DefinitionError(f"{name[:MAX_NAME]!r} is not the name of a type such as std_msgs/msg/String")
    return name


def checked(definition: Definition) -> Definition:
    """Return a definition that can be used, with the filler if it has no field. Raises DefinitionError."""
    name = check_name(definition.name)
    if len(definition.fields) > MAX_FIELDS:
        raise DefinitionError(f"{name} has {len(definition.fields)} fields; {MAX_FIELDS} is the maximum")
    if len({field.name for field in definition.fields}) < len(definition.fields):
        raise DefinitionError(f"{name} has two fields of one name")
    for field in definition.fields:
        if len(field.name) > MAX_NAME or not _FIELD_NAME.match(field.name):
            raise DefinitionError(f"{name} has a field {field.name[:MAX_NAME]!r}; letters, digits and _ make a name")
        if field.type not in PRIMITIVES:
            check_name(field.type)
        if not 0 <= field.size <= MAX_SIZE or (field.arity == "array" and field.size == 0):
            raise DefinitionError(f"{name}.{field.name} has {field.size} items; 1 to {MAX_SIZE} can be used")
    if definition.fields:
        return definition
    return Definition(name, (Field(FILLER, "uint8"),), definition.constants)


def read_text(text: str, name: str) -> list[Definition]:
    """Return what a .msg, .srv or .action file defines, with all parts that ROS derives from it.

    The kind is that of the name, as in ``std_srvs/srv/Trigger``. Raises DefinitionError, which names the line.
    """
    package, kind, short = check_name(name).split("/")
    if len(text) > MAX_TEXT:
        raise DefinitionError(f"{name}: {len(text)} characters; {MAX_TEXT} is the maximum")
    parts = [""]
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() == "---":
            parts.append("")
        else:
            parts[-1] += f"{number} {line}\n"
    names = {"msg": ("",), "srv": ("_Request", "_Response"), "action": ("_Goal", "_Result", "_Feedback")}[kind]
    if len(parts) != len(names):
        raise DefinitionError(f"{name}: it has {len(parts)} parts; a .{kind} has {len(names)}, parted by '---'")
    said = [
        _read_part(part, f"{package}/{kind}/{short}{suffix}", package)
        for part, suffix in zip(parts, names, strict=True)
    ]
    return [*said, *derived(name)]


def derived(name: str) -> list[Definition]:
    """Return the types that ROS makes of a service or an action, apart from those that its file states."""
    kind = name.split("/")[1]
    if kind == "srv":
        return _service(name)
    return _action(name) if kind == "action" else []


def _service(name: str) -> list[Definition]:
    event = (
        Field("info", "service_msgs/msg/ServiceEventInfo"),
        Field("request", f"{name}_Request", "bounded", 1),
        Field("response", f"{name}_Response", "bounded", 1),
    )
    parts = _fields(
        request_message=f"{name}_Request", response_message=f"{name}_Response", event_message=f"{name}_Event"
    )
    return [Definition(f"{name}_Event", event), Definition(name, parts)]


def _action(name: str) -> list[Definition]:
    uuid, time = "unique_identifier_msgs/msg/UUID", "builtin_interfaces/msg/Time"
    messages = {
        "SendGoal_Request": _fields(goal_id=uuid, goal=f"{name}_Goal"),
        "SendGoal_Response": _fields(accepted="bool", stamp=time),
        "GetResult_Request": _fields(goal_id=uuid),
        "GetResult_Response": _fields(status="int8", result=f"{name}_Result"),
        "FeedbackMessage": _fields(goal_id=uuid, feedback=f"{name}_Feedback"),
    }
    parts = _fields(
        goal=f"{name}_Goal", result=f"{name}_Result", feedback=f"{name}_Feedback", send_goal_service=f"{name}_SendGoal",
        get_result_service=f"{name}_GetResult", feedback_message=f"{name}_FeedbackMessage",
    )  # fmt: skip
    said = [Definition(f"{name}_{suffix}", fields) for suffix, fields in messages.items()]
    return [*said, *_service(f"{name}_SendGoal"), *_service(f"{name}_GetResult"), Definition(name, parts)]


def _fields(**types: str) -> tuple[Field, ...]:
    return tuple(Field(name, type_) for name, type_ in types.items())


def _read_part(text: str, name: str, package: str) -> Definition:
    fields, constants = list[Field](), list[tuple[str, Any]]()
    for numbered in text.splitlines():
        number, _, line = numbered.partition(" ")
        match = _COMMENT.match(line)
        line = (match[1] if match else line).strip()
        if not line:
            continue
        try:
            field, is_constant = _read_line(line, package)
        except DefinitionError as error:
            raise DefinitionError(f"{name}, line {number}: {error}") from error
        if is_constant:
            constants.append((field.name, field.default))
        else:
            fields.append(field)
    return checked(Definition(name, tuple(fields), tuple(constants)))


def _read_line(line: str, package: str) -> tuple[Field, bool]:
    """Return a field, or a constant as a field whose default is its value, and which of both it is."""
    match = _LINE.match(line)
    if match is None:
        raise DefinitionError(f"{line[:80]!r} is neither 'TYPE NAME' nor 'TYPE NAME=VALUE'")
    type_ = _full_type(match["type"], package)
    arity: Arity = "one"
    if match["array"]:
        arity = "bounded" if match["upto"] else "array" if match["size"] else "sequence"
    field = Field(match["name"], type_, arity, int(match["size"] or 0), int(match["text"] or 0))
    if not match["value"]:
        return field, False
    default = read_default(match["value"].strip(), field)
    return Field(field.name, type_, arity, field.size, field.text_size, default), bool(match["constant"])


def _full_type(written: str, package: str) -> str:
    if written == "char":
        return "uint8"
    if written in PRIMITIVES:
        return written
    if written == "Header":
        return "std_msgs/msg/Header"
    parts = written.split("/")
    return {1: f"{package}/msg/{written}", 2: f"{parts[0]}/msg/{parts[-1]}"}.get(len(parts), written)


def read_default(text: str, field: Field) -> Any:
    """Return a default value or constant from its text. Raises DefinitionError."""
    if field.arity == "one":
        return _scalar(text, field)
    inner = text[1:-1] if text[:1] in "[(" and text[-1:] in "])" else text
    found = _QUOTED.findall(inner) if field.type in TEXTS else [each for each in inner.split(",") if each.strip()]
    return [_scalar(each.strip(), field) for each in found]


def _scalar(text: str, field: Field) -> Any:
    try:
        if field.type in TEXTS:
            return re.sub(r"\\(.)", r"\1", text[1:-1]) if _QUOTED.fullmatch(text) else text
        if field.type == "bool":
            return {"true": True, "1": True, "false": False, "0": False}[text.lower()]
        if field.type in ("float32", "float64"):
            return float(text)
        if field.type in NUMBERS:
            return int(text, 0)
    except (ValueError, KeyError) as error:
        raise DefinitionError(f"{text[:80]!r} is no value of {field.name}, which is a {field.type}") from error
    raise DefinitionError(f"{field.name} has a default; a {field.type} can have none")


class Definitions(Mapping[str, Definition]):
    """Definitions by name, of one distribution of ROS for example. Those of ``others`` come after its own."""

    def __init__(self, own: Mapping[str, Definition], others: Sequence[Mapping[str, Definition]] = ()) -> None:
        self._maps = (own, *others)

    def __getitem__(self, name: str) -> Definition:
        for each in self._maps:
            if (found := each.get(name)) is not None:
                return found
        raise DefinitionError(f"the type {name} is not defined")

    def get(self, name: str, default: Any = None) -> Any:
        return next((found for each in self._maps if (found := each.get(name)) is not None), default)

    def __contains__(self, name: object) -> bool:
        return any(name in each for each in self._maps)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys(name for each in self._maps for name in each))

    def __len__(self) -> int:
        return len(set(self))
