"""Paths of a description: fleet, robots, joints, links, their properties, actions and invocations.

Everything of the same form has one path. Links of a new invocation lead to reading, cancelling and deleting it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from linked_fleet_gateway.api import Container, Property, RequestView, joint_path, link_path, robot_path
from linked_fleet_gateway.extensions.openapi.components import ANNOTATIONS, LOCK_TOKEN
from linked_fleet_gateway.extensions.openapi.declared import (
    Names,
    any_of,
    is_declared,
    may_lack_body,
    outcome_members,
    read_schema,
)
from linked_fleet_gateway.extensions.openapi.operations import (
    CHANGED_PLACEMENT_RESPONSE,
    CHANGED_RESPONSE,
    ID_SCHEMA,
    INVOCATION,
    JSONLD,
    Parameters,
    component_ref,
    get_operation,
    header_ref,
    invocation_responses,
    last_segment,
    parameter,
    patch_operation,
    path_item,
    rdf_get_operation,
    resource_path_items,
    segment_schema,
    write_operation,
)
from linked_fleet_gateway.extensions.openapi.schemas import (
    example,
    extract_alternatives,
    forbid_other_members,
    generalize_iris,
    has_example,
    union,
)
from linked_fleet_gateway.faces import (
    Form,
    Json,
    Offer,
    RobotPart,
    Setting,
    form_of,
    form_of_input,
    form_of_target,
    offers_at,
    parts_of,
    properties_at,
)
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.model import Joint, Link
from linked_fleet_state.robot import Robot

_FORMAT: Json = {"type": "string", "enum": ["json", "jsonld"], "default": "json"}
_PICKS = "The format of what is sent."
PICK = parameter("as", "query", _FORMAT, _PICKS)


def action_paths(
    template: str,
    name: str,
    parameters: Parameters,
    offers: Sequence[Offer],
    body: Json | None,
    invocation: Json = INVOCATION,
) -> dict[str, Json]:
    """Return the path items of an action at ``template`` and below; ``offers``: one for each thing that has it.

    ``body`` is a media type object, ``invocation`` the schema of its invocations.
    """
    definition = offers[0].definition
    one = {**parameters, "invocation": ID_SCHEMA}
    listed, read = f"{template}/invocations", f"{template}/invocations/{{invocation}}"
    done: Json = {"204": {"description": "It has ended; a robot holds."}}
    cancel = rdf_get_operation(f"describeCancel{name}", "Describe the action cancel of a running invocation")
    return {
        template: path_item(
            parameters,
            get=rdf_get_operation(f"describe{name}", f"{definition.title}: description and shape of the body"),
            **{
                method.lower(): _invoke(method, name, parameters, offers, body, invocation)
                for method in offers[0].methods
            },
        ),
        f"{template}/produceshape": path_item(parameters, get=rdf_get_operation(f"shape{name}", "Shape of the result")),
        listed: path_item(parameters, get=rdf_get_operation(f"list{name}", "Invocations, the newest first")),
        read: path_item(
            one,
            get=rdf_get_operation(f"read{name}", "Read an invocation: its state, progress and result", invocation),
            delete=write_operation(f"delete{name}", "Stop an invocation and remove it", done),
        ),
        f"{read}/blueprint": path_item(one, get=rdf_get_operation(f"blueprint{name}", "Shape of an invocation")),
        f"{read}/actions/cancel": path_item(
            one, get=cancel, post=write_operation(f"cancel{name}", "Cancel an invocation and keep it", done)
        ),
    }


def capitalized(name: str) -> str:
    return name[0].upper() + name[1:]


def _invoke(
    method: str, name: str, parameters: Parameters, offers: Sequence[Offer], body: Json | None, invocation: Json
) -> Json:
    offer = offers[0]
    # A wrong query must never prevent a stop: a request without a body accepts any format name.
    pick = parameter("as", "query", {"type": "string", "default": "json"}, _PICKS) if body is None else PICK
    fields = ["Prefer"] if offer.is_stop else ["Prefer", "IdempotencyKey", "LockToken", "IfMatch"]
    return write_operation(
        ("put" if method == "PUT" else "invoke") + name,
        offer.definition.title,
        invocation_responses(name, parameters, invocation),
        None if body is None else {JSON: body},
        [pick, *map(header_ref, fields)],
        description=_described(offers),
        body_is_optional=any(map(may_lack_body, offers)),
    )


def _described(offers: Sequence[Offer]) -> str:
    """Return the comment of an action, and how it is opened as a stream, which OpenAPI has no words for."""
    protocols = {each.stream_protocol for each in offers if each.stream_protocol}
    streams = [f" A WebSocket on this path with the subprotocol {each} opens it as a stream." for each in protocols]
    return offers[0].definition.comment + "".join(streams)


_MOST_NAMED = 8
"""Up to this number of robots, bodies list the names of joints."""
_MOST_FORMS = 256


@dataclass
class _CommonPath:
    """Properties or actions with the same name, and the robots and parts that have them."""

    robots: dict[str, None] = field(default_factory=dict)
    parts: dict[str, None] = field(default_factory=dict)
    kinds: dict[str, None] = field(default_factory=dict)
    items: list[Property] = field(default_factory=list)
    offers: list[Offer] = field(default_factory=list)

    def note(self, robot: str, part: str = "", kind: str = "") -> None:
        self.robots[robot] = None
        if part:
            self.parts[part], self.kinds[kind] = None, None

    def parameters(self) -> Parameters:
        robots = {"robot": segment_schema(self.robots)}
        if not self.parts:
            return robots
        (name,) = self.kinds if len(self.kinds) == 1 else ("part",)
        return robots | {name: segment_schema(self.parts)}

    def template(self, end: str) -> str:
        return "".join(f"/{{{name}}}" for name in self.parameters()) + end


class FleetPaths:
    """Collects the contents of robots, one robot at a time, and then yields the paths."""

    def __init__(self, view: RequestView) -> None:
        self._base = view.base
        self._robots, self._parts = _CommonPath(), _CommonPath()
        self._properties: dict[tuple[bool, str], _CommonPath] = {}
        self._actions: dict[tuple[bool, str], _CommonPath] = {}
        self._values: list[Json] = []
        self._names = Names()
        self._names_of_actions: dict[tuple[bool, str], str] = {}
        self.schemas: dict[str, Json] = {}
        """Schemas of bodies by name, filled by ``paths``."""

    def add(self, robot: Robot) -> None:
        """Add a robot; one without a readable description has no parts and no properties."""
        name = last_segment(robot_path(robot.name))
        self._robots.note(name)
        if robot.model is None:
            return
        self._note(robot, None, name)
        for joint in robot.model.joints.values():
            self._note(robot, joint, name, last_segment(joint_path(robot.name, joint.name)), "joint")
        for link in robot.model.links.values():
            self._note(robot, link, name, last_segment(link_path(robot.name, robot.model, link.name)), "link")
        for added in parts_of(robot).values():
            self._note(robot, added, name, last_segment(added.path), "component")
            self._values.append(added.json_schema)

    def _note(
        self, of: Robot, thing: Joint | Link | RobotPart | None, robot: str, part: str = "", kind: str = ""
    ) -> None:
        if part:
            self._parts.note(robot, part, kind)
        for item in properties_at(self._base, of, thing):
            found = self._properties.setdefault((bool(part), item.segment), _CommonPath())
            found.note(robot, part, kind)
            found.items.append(item)
        for offer in offers_at(of, thing):
            found = self._actions.setdefault((bool(part), offer.definition.segment), _CommonPath())
            found.note(robot, part, kind)
            found.offers.append(offer)

    def paths(self) -> Iterator[tuple[str, Json]]:
        """Yield path items by template. Each schema of a joint takes about a millisecond."""
        yield from _thing("/", {}, "Fleet").items()
        for offer in offers_at(None):
            name = capitalized(offer.definition.segment)
            yield from action_paths(offer.path, name, {}, [offer], self._body(name, [offer], form_of_input)).items()
        yield "/vocabulary", path_item({}, get=rdf_get_operation("readVocabulary", "Terms and shapes"))
        context: Json = {JSONLD: {"schema": component_ref("schemas", "JsonLd")}}
        yield "/context", path_item({}, get=get_operation("readContext", "JSON-LD context", context))
        if not self._robots.robots:
            return
        robots = self._robots.parameters()
        yield from _thing("/{robot}/", robots, "Robot", delete=_FORGET).items()
        self.schemas["ControlLeaseInput"] = forbid_other_members(form_of(LF.ControlLeaseInput).schema)
        yield from _lease(robots).items()
        if self._parts.parts:
            parts = self._parts
            yield from _thing(parts.template(""), parts.parameters(), "Part", self._values_of_components()).items()
        self._names_of_actions = {key: self._names.new(self._name(*key)) for key in self._actions}
        for (in_part, called), alike in self._properties.items():
            yield from self._property(alike, in_part, called).items()
        for (in_part, called), alike in self._actions.items():
            name = self._names_of_actions[in_part, called]
            body = self._body(name, alike.offers, form_of_input)
            template, parameters = alike.template(f"/actions/{called}"), alike.parameters()
            result = self._invocation(name, alike.offers)
            yield from action_paths(template, name, parameters, alike.offers, body, result).items()

    def _values_of_components(self) -> Json | None:
        """Return the schema of the values of a whole component; None if there is none. Joints and links have none."""
        if not self._values:
            return None
        name = self._names.new("PartValues")
        refs = list[Json]()
        for number, schema in enumerate(self._values, 1):
            members = {
                each: self._named(value, f"{name}{number}{capitalized(each)}")
                for each, value in schema["properties"].items()
            }
            self.schemas[f"{name}{number}"] = schema | {"properties": members}
            refs.append(component_ref("schemas", f"{name}{number}"))
        self.schemas[name] = any_of(refs)
        return component_ref("schemas", name)

    def _named(self, schema: Json, name: str) -> Json:
        """Return the schema of a value, or null, with its objects as named ones, from which generators make classes."""
        known = next((each for each in schema.get("oneOf", ()) if each.get("type") in ("object", "array")), None)
        if known is None:
            return schema
        inner = known.get("items", known)
        if inner.get("type") != "object":
            return schema
        self.schemas[name] = inner
        ref = component_ref("schemas", name)
        said = ref if inner is known else known | {"items": ref}
        return schema | {"oneOf": [said, *(each for each in schema["oneOf"] if each is not known)]}

    def _name(self, in_part: bool, called: str) -> str:
        """Return the name of an action. Robots, their joints and their components may have actions of one name."""
        if not in_part:
            return capitalized(called) + ("OfRobot" if (True, called) in self._actions else "")
        return capitalized(called) + ("OfComponent" if [*self._actions[True, called].kinds] == ["component"] else "")

    def of_members(self, container: Container[Any], own: Sequence[Offer]) -> dict[str, Json]:
        """Return the path items of the actions of the members of a container.

        All members have those of their kind. ``own`` are further ones of single members, by ``Container.actions``.
        """
        paths: dict[str, Json] = {}
        for offer in container.offers(f"{container.path}/{{id}}", container.title):
            paths |= self._of_members(container, [offer], {"id": ID_SCHEMA})
        alike: dict[str, list[Offer]] = {}
        for each in own:
            alike.setdefault(each.definition.segment, []).append(each)
        for offers in alike.values():
            paths |= self._of_members(container, offers, {"id": segment_schema(each.thing for each in offers)})
        return paths

    def _of_members(self, container: Container[Any], offers: list[Offer], parameters: Parameters) -> dict[str, Json]:
        segment = offers[0].definition.segment
        name = self._names.new(capitalized(segment) + capitalized(container.segment.strip("~")))
        template = f"{container.path}/{{id}}/actions/{segment}"
        return action_paths(template, name, parameters, offers, self._body(name, offers, form_of_input))

    def _body(self, name: str, offers: list[Offer], form: Callable[[Offer, str], Form]) -> Json | None:
        """Return the media type object that all of ``offers`` accept; None if they take no body."""
        takers = [each for each in offers if each.takes_body]
        if not takers:
            return None
        declared = [form(each, self._base).schema for each in takers if is_declared(each)]
        alike = self._distinct(each for each in takers if not is_declared(each))
        few, known = len(self._robots.robots) <= _MOST_NAMED, len(alike) <= _MOST_FORMS
        forms = [form(each, self._base).schema for each in alike[:_MOST_FORMS]]
        shown = forms if few else [generalize_iris(each, self._base) for each in forms]
        shared = [] if not shown else [union(shown) if known else {"type": "object"}]
        schema = forbid_other_members(any_of([*shared, *declared])) if known else {"type": "object"}
        first = (forms or declared)[0]
        self.schemas[f"{name}Input"] = extract_alternatives(schema, f"{name}Input", self.schemas)
        examples = {"examples": {"first": {"value": example(first)}}} if has_example(first) else {}
        return {"schema": component_ref("schemas", f"{name}Input"), **examples}

    def _invocation(self, name: str, offers: Sequence[Offer]) -> Json:
        """Return the schema of the invocations of ``offers``: that of all actions, or one with what they return."""
        if not (members := outcome_members(offers)):
            return INVOCATION
        self.schemas[f"{name}Invocation"] = form_of(LF.InvocationShape).schema_with(members)
        return component_ref("schemas", f"{name}Invocation")

    def _distinct(self, offers: Iterable[Offer]) -> list[Offer]:
        """Return one offer for each distinct body schema.

        Joints with equal limits share a schema, and so do equal robots where bodies do not list joints.
        """
        found: dict[tuple[object, ...], Offer] = {}
        for each in offers:
            robot, joint = each.robot, each.joint
            own = (each.path,) if joint is None else (joint.kind, joint.limits)
            if robot is not None and robot.description is not None and len(self._robots.robots) > _MOST_NAMED:
                about = (robot.description.urdf, robot.commanded, robot.annotations)
                found.setdefault((about, *own[1:], own[0] if joint else ""), each)
            else:
                found.setdefault((robot and robot.name, *own), each)
        return list(found.values())

    def _property(self, alike: _CommonPath, in_part: bool, called: str) -> dict[str, Json]:
        item, parameters, template = alike.items[0], alike.parameters(), alike.template(f"/{called}")
        (*_, owner), form = parameters, read_schema(alike.items)
        of, title = self._names.new(capitalized(owner) + capitalized(called)), f"The {called} of a {owner}"
        schema = None
        if form is not None:
            self.schemas[of], schema = form, component_ref("schemas", of)
        methods = {"get": rdf_get_operation(f"read{of}", title, schema)}
        if puts := [each.put for each in alike.items if isinstance(each.put, Offer)]:
            body = self._body(of, puts, form_of_target)
            answers = invocation_responses(self._names_of_actions[in_part, puts[0].definition.segment], parameters)
            fields = [PICK, *map(header_ref, ("Prefer", "IdempotencyKey", "LockToken", "IfMatch"))]
            methods["put"] = write_operation(f"put{of}", puts[0].definition.title, answers, {JSON: body or {}}, fields)
        elif isinstance(item.put, Setting):
            methods |= self._setting(of, item.put)
        return resource_path_items(template, parameters, of, title, **methods)

    def _setting(self, of: str, setting: Setting) -> Mapping[str, Json]:
        shape, fields = setting.shape, (header_ref("IfMatch"), header_ref("LockToken"))
        self.schemas[f"{of}Input"] = ANNOTATIONS if shape is None else forbid_other_members(form_of(shape).schema)
        body = {JSONLD if shape is None else JSON: {"schema": component_ref("schemas", f"{of}Input")}}
        responses = CHANGED_PLACEMENT_RESPONSE if setting.decides_checks else CHANGED_RESPONSE
        found = {
            "put": write_operation(f"put{of}", "Replace it", responses, body, fields),
            "patch": patch_operation(f"patch{of}", "Change it by a SPARQL update", ("IfMatch", "LockToken"), responses),
        }
        removed = write_operation(f"delete{of}", "Remove it", CHANGED_RESPONSE, None, fields)
        return found | ({"delete": removed} if setting.removable else {})


_FORGET: Json = write_operation(
    "removeRobot",
    "Remove a robot that has gone for good, with its settings",
    {"204": {"description": "Removed."}},
    None,
    (header_ref("LockToken"), header_ref("IfMatch")),
)


def _thing(
    template: str, parameters: Parameters, kind: str, values: Json | None = None, **methods: Json
) -> dict[str, Json]:
    """Return the path items of a thing; ``values`` is the schema of those in plain JSON, which some have."""
    stem, linkset = (
        template.rstrip("/"),
        {"application/linkset+json": {"schema": {"type": "object", "required": ["linkset"]}}},
    )
    title = f"{kind}: description, properties and actions"
    whole, blueprint = resource_path_items(
        stem, parameters, kind, title, rdf_get_operation(f"read{kind}", title, values, some=True), **methods
    ).values()
    get = get_operation(f"read{kind}Links", f"Links of a {kind.lower()} (RFC 9264)", linkset)
    links = path_item(parameters, get=get)
    return {template: whole, f"{stem}/blueprint": blueprint, f"{stem}/linkset": links}


def _lease(robots: Parameters) -> dict[str, Json]:
    schema = component_ref("schemas", "ControlLeaseInput")
    taken = {
        "204": {"description": "Control is yours.", "headers": {"Lock-Token": component_ref("headers", "LockToken")}}
    }
    body = {JSON: {"schema": schema, "examples": {"a minute": {"value": {"holder": "a planner", "duration": 60}}}}}
    proof = parameter("Lock-Token", "header", LOCK_TOKEN, "As it came.", required=True)
    return resource_path_items(
        "/{robot}/lease",
        robots,
        "Lease",
        "Control of a robot: holder and end",
        put=write_operation(
            "takeLease", "Take or renew control", taken, body, (header_ref("LockToken"), header_ref("IfMatch"))
        ),
        delete=write_operation(
            "releaseLease", "Release control", {"204": {"description": "Released."}}, None, (proof,)
        ),
    )
