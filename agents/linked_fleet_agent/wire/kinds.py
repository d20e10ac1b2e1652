"""Known kinds of components: what clients can rely on in a component whose ``@type`` is one of them. Pure.

Each kind is the least declaration of its components. A component may have more members, narrower ranges and fewer
choices, and may let more be set. Clients that know a kind alone can use every component of it.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

from msgspec import Struct
from msgspec.structs import replace

from linked_fleet_agent.wire.declaration import BASE, Action, Component, Event, Property
from linked_fleet_agent.wire.schema import Schema, Type

LF = "https://w3id.org/linked-fleet#"
DCTERMS = "http://purl.org/dc/terms/"
OFF_PATH, NOT_MOVED = "the base is off its path", "the base has not moved"
"""A base that follows a path fails with a reason that begins like this if another path may help."""
M = TypeVar("M")


class Kind(Struct, frozen=True, kw_only=True):
    """A kind. Components may lack ``optional`` members, and have at least one of ``either``, if it names any.

    Actions in ``still`` move nothing, so that they work while nothing may move.
    """

    least: Component
    optional: frozenset[str] = frozenset()
    either: tuple[str, ...] = ()
    still: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        return self.least.semantic_type.removeprefix(LF)


def _number(term: str, unit: str = "", least: float | None = None, most: float | None = None) -> Schema:
    return Schema(type="number", semantic_type=LF + term, unit=unit, minimum=least, maximum=most)


def _of(type_: Type, term: str, *choices: str) -> Schema:
    return Schema(type=type_, semantic_type=term if ":" in term else LF + term, enum=choices)


def _object(*required: str, **members: Schema) -> Schema:
    return Schema(type="object", properties=members, required=required)


def _read(**schemas: Schema) -> dict[str, Property]:
    return {name: Property(schema=each) for name, each in schemas.items()}


_WIDTH, _FORCE = _number("width", "M", 0), _number("grippingForce", "N", 0)
_HOLDING = _of("boolean", "holding")
_GRIPPER = Kind(
    least=Component(
        name="gripper",
        semantic_type=LF + "Gripper",
        properties=_read(width=_WIDTH, force=_FORCE, holding=_HOLDING),
        actions={
            "grasp": Action(
                semantic_type=LF + "Grasp",
                input=_object(width=_WIDTH, force=_FORCE),
                result=_object("width", "holding", width=_WIDTH, holding=_HOLDING, force=_FORCE),
            ),
            "open": Action(semantic_type=LF + "OpenGripper", input=_object(width=_WIDTH)),
        },
        events={"lost": Event(semantic_type=LF + "ObjectLost")},
    )
)
_BATTERY = Kind(
    least=Component(
        name="battery",
        semantic_type=LF + "Battery",
        properties=_read(
            charge=_number("charge", "PERCENT", 0, 100),
            powerSupplyState=_of("string", "powerSupplyState", "charging", "discharging", "full", "unknown"),
            voltage=_number("voltage", "V"),
            current=_number("electricCurrent", "A"),
        ),
    ),
    optional=frozenset({"voltage", "current"}),
)
_SWITCH = Kind(
    least=Component(
        name="switch",
        semantic_type=LF + "Switch",
        properties={
            "output": Property(schema=_of("boolean", "digitalOutput"), writable=True),
            "input": Property(schema=_of("boolean", "digitalInput")),
        },
    ),
    optional=frozenset({"output", "input"}),
    either=("output", "input"),
)
_MODE = Kind(
    least=Component(
        name="mode",
        semantic_type=LF + "Mode",
        properties={
            "mode": Property(schema=_of("string", "operationalMode", "manual", "automatic"), writable=True),
            **_read(
                protectiveStop=_of("boolean", "protectiveStop"),
                reason=_of("string", "stopReason"),
                speedScale=_number("speedScaling", "", 0, 1),
            ),
        },
        actions={"reset": Action(semantic_type=LF + "ResetProtectiveStop")},
    ),
    still=frozenset({"reset"}),
)
_DIAGNOSTICS = Kind(
    least=Component(
        name="diagnostics",
        semantic_type=LF + "Diagnostics",
        properties=_read(
            status=Schema(
                type="array",
                semantic_type=LF + "diagnosticStatus",
                items=_object(
                    "name",
                    "level",
                    "message",
                    name=_of("string", DCTERMS + "title"),
                    level=_of("string", "diagnosticLevel", "ok", "warning", "error", "stale"),
                    message=_of("string", DCTERMS + "description"),
                ),
            )
        ),
    )
)
_X, _Y, _HEADING = _number("x", "M"), _number("y", "M"), _number("heading", "RAD")
_POSE = _object("x", "y", "heading", x=_X, y=_Y, heading=_HEADING)
_LINEAR, _LATERAL = _number("linearVelocity", "M-PER-SEC"), _number("lateralVelocity", "M-PER-SEC")
_ANGULAR = _number("angularVelocity", "RAD-PER-SEC")
_PATH = Schema(type="array", semantic_type=LF + "path", items=_object("x", "y", x=_X, y=_Y, heading=_HEADING))
_ERRORS = {"error": _number("positionError", "M", 0), "headingError": _number("headingError", "RAD", 0)}
_STATION_NAME = _of("string", "stationName")
_BASE = Kind(
    least=Component(
        name="base",
        semantic_type=LF + "Base",
        properties=_read(
            pose=replace(_POSE, semantic_type=LF + "planarPose"),
            twist=replace(
                _object("linear", "lateral", "angular", linear=_LINEAR, lateral=_LATERAL, angular=_ANGULAR),
                semantic_type=LF + "planarTwist",
            ),
            footprint=Schema(type="array", semantic_type=LF + "footprint", items=_object("x", "y", x=_X, y=_Y)),
            driveLimits=replace(
                _object(
                    *("linear", "lateral", "angular", "linearAcceleration", "angularAcceleration"),
                    linear=_LINEAR,
                    lateral=_LATERAL,
                    angular=_ANGULAR,
                    linearAcceleration=_number("linearAcceleration", "M-PER-SEC2"),
                    angularAcceleration=_number("angularAcceleration", "RAD-PER-SEC2"),
                ),
                semantic_type=LF + "driveLimits",
            ),
            path=_PATH,
            stations=Schema(
                type="array",
                semantic_type=LF + "stations",
                items=_object(
                    *("name", "x", "y", "heading"),
                    name=_STATION_NAME,
                    x=_X,
                    y=_Y,
                    heading=_HEADING,
                    approach=_number("approachLength", "M", 0),
                ),
            ),
            dockedAt=_of("string", "dockedAt"),
        ),
        actions={
            "drive": Action(
                semantic_type=LF + "Drive",
                input=_object(linear=_LINEAR, angular=_ANGULAR, duration=_number("driveDuration", "SEC", 0, 1)),
                moves=(BASE,),
            ),
            "followPath": Action(
                semantic_type=LF + "FollowPath",
                input=_object(
                    "path",
                    path=_PATH,
                    speed=_number("speedShare", "", 0, 1),
                ),
                result=_object(*_ERRORS, **_ERRORS),
                moves=(BASE,),
            ),
            "dock": Action(
                semantic_type=LF + "Dock",
                input=_object(station=_STATION_NAME),
                result=_object("station", *_ERRORS, station=_STATION_NAME, **_ERRORS),
                moves=(BASE,),
            ),
            "undock": Action(semantic_type=LF + "Undock", moves=(BASE,)),
        },
    ),
    optional=frozenset({"driveLimits", "followPath", "path", "stations", "dockedAt", "dock", "undock"}),
)
_JOGGING = Kind(
    least=Component(
        name="jogging",
        semantic_type=LF + "Jogging",
        properties=_read(
            accelerations=replace(_object(), semantic_type=LF + "jointAccelerations"),
            limitedBecause=_of("string", "limitedBecause"),
        ),
        actions={
            "jogJoints": Action(
                semantic_type=LF + "JogJoints",
                input=_object(
                    velocities=replace(_object(), semantic_type=LF + "jointVelocities"),
                    duration=_number("driveDuration", "SEC", 0, 1),
                ),
            )
        },
    ),
)
KINDS: Mapping[str, Kind] = {
    each.least.semantic_type: each for each in (_GRIPPER, _BATTERY, _SWITCH, _MODE, _DIAGNOSTICS, _BASE, _JOGGING)
}
"""The known kinds by IRI."""


def kind_problem(component: Component) -> str:
    """Return a sentence about how a component does not conform to the known kind that it claims, or an empty string."""
    kind = KINDS.get(component.semantic_type)
    return "" if kind is None else next(_problems(kind, component), "")


def _problems(kind: Kind, component: Component) -> Iterator[str]:
    if kind.either and not set(kind.either) & component.properties.keys():
        yield f"a {kind.name} has a property {' or '.join(map(repr, kind.either))}; this one has none"
    for name, known in kind.least.properties.items():
        where = f"a {kind.name} has a property {name!r}"
        declared = component.properties.get(name)
        if declared is not None:
            yield from _of_property(where, known, declared)
        elif name not in kind.optional:
            yield f"{where}; this one has none"
    for name, action in kind.least.actions.items():
        where, offered = f"a {kind.name} has an action {name!r}", component.actions.get(name)
        if offered is None:
            if name not in kind.optional:
                yield f"{where}; this one has none"
        else:
            yield from _of_action(where, action, offered, is_still=name in kind.still)
    for name, event in kind.least.events.items():
        where, told = f"a {kind.name} has an event {name!r}", component.events.get(name)
        if told is None:
            yield f"{where}; this one has none"
        else:
            yield from _of_term(where, event.semantic_type, told.semantic_type)


def _of_property(where: str, known: Property, declared: Property) -> Iterator[str]:
    yield from _of_schema(where, known.schema, declared.schema)
    if known.writable and not declared.writable:
        yield f"{where} that can be set; this one's cannot"


def _of_action(where: str, known: Action, declared: Action, *, is_still: bool) -> Iterator[str]:
    if is_still and declared.moves:
        yield f"{where} that moves nothing; this one's moves {declared.moves[0]}"
    for moved in known.moves:
        if moved not in declared.moves:
            yield f"{where} that moves {moved}; this one's does not"
    yield from _of_term(where, known.semantic_type, declared.semantic_type)
    yield from _of_input(f"{where} with an input", known.input, declared.input)
    if known.result is not None:
        if declared.result is None:
            yield f"{where} with a result; this one's has none"
        else:
            yield from _of_schema(f"{where} with a result", known.result, declared.result)


def _of_input(where: str, known: Schema | None, declared: Schema | None) -> Iterator[str]:
    """Yield what a client that knows the kind alone would stumble over."""
    members = {} if declared is None else declared.properties
    for name, member in {} if known is None else known.properties.items():
        if name not in members:
            yield f"{where} {name!r}; this one's has none"
        else:
            yield from _of_schema(f"{where} {name!r}", member, members[name])
    for name in () if declared is None else declared.required:
        if known is None or name not in known.required:
            yield f"{where} that may lack {name!r}; this one requires it"


def _of_schema(where: str, known: Schema, declared: Schema) -> Iterator[str]:
    if declared.type != known.type and (known.type, declared.type) != ("number", "integer"):
        yield f"{where} of the type {known.type}; this one's is of the type {declared.type}"
        return
    if declared.unit != known.unit:
        yield f"{where} {_in_unit(known)}; this one's is {_in_unit(declared)}"
    yield from _of_term(where, known.semantic_type, declared.semantic_type)
    yield from _of_range(where, known, declared)
    if known.enum and not (declared.enum and set(declared.enum) <= set(known.enum)):
        choices = ", ".join(map(str, declared.enum)) or "any text"
        yield f"{where} that is one of {', '.join(map(str, known.enum))}; this one's is one of {choices}"
    if known.items is not None and declared.items is not None:
        yield from _of_schema(f"{where} with items", known.items, declared.items)
    for name, member in known.properties.items():
        if name in known.required and name not in declared.required:
            yield f"{where} that always has {name!r}; this one's may lack it"
        elif name in declared.properties:
            yield from _of_schema(f"{where} with {name!r}", member, declared.properties[name])


def _in_unit(schema: Schema) -> str:
    return f"in {schema.unit}" if schema.unit else "without unit"


def _of_term(where: str, known: str, declared: str) -> Iterator[str]:
    if known and declared != known:
        yield f"{where} of the @type {known}; this one's is of {declared or 'none'}"


def _of_range(where: str, known: Schema, declared: Schema) -> Iterator[str]:
    low = declared.minimum if declared.minimum is not None else declared.exclusive_minimum
    high = declared.maximum if declared.maximum is not None else declared.exclusive_maximum
    if known.minimum is not None and (low is None or low < known.minimum):
        yield f"{where} of at least {known.minimum}; this one's {_bound('minimum', low)}"
    if known.maximum is not None and (high is None or high > known.maximum):
        yield f"{where} of at most {known.maximum}; this one's {_bound('maximum', high)}"


def _bound(word: str, said: float | None) -> str:
    return f"has no {word}" if said is None else f"has the {word} {said}"


def with_terms(component: Component) -> Component:
    """Return a component with the terms of its kind, if it is known, at members that have no ``@type`` of their own."""
    kind = KINDS.get(component.semantic_type)
    if kind is None:
        return component
    known = kind.least
    return replace(
        component,
        properties=_completed(known.properties, component.properties, _property_with_term),
        actions=_completed(known.actions, component.actions, _action_with_terms),
        events=_completed(known.events, component.events, _event_with_term),
    )


def _completed(known: Mapping[str, M], declared: Mapping[str, M], complete: Callable[[M, M], M]) -> dict[str, M]:
    return {name: complete(known[name], each) if name in known else each for name, each in declared.items()}


def _property_with_term(known: Property, declared: Property) -> Property:
    return replace(declared, schema=_with_term(known.schema, declared.schema))


def _event_with_term(known: Event, declared: Event) -> Event:
    return replace(declared, semantic_type=declared.semantic_type or known.semantic_type)


def _action_with_terms(known: Action, declared: Action) -> Action:
    given = {
        part: _with_term(schema, said)
        for part in ("input", "result")
        if (schema := getattr(known, part)) is not None and (said := getattr(declared, part)) is not None
    }
    return replace(declared, semantic_type=declared.semantic_type or known.semantic_type, **given)


def _with_term(known: Schema, declared: Schema) -> Schema:
    items = declared.items
    if known.items is not None and items is not None:
        items = _with_term(known.items, items)
    members = _completed(known.properties, declared.properties, _with_term)
    term = declared.semantic_type or known.semantic_type
    return replace(declared, semantic_type=term, items=items, properties=members)
