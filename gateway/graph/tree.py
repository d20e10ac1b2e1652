"""The resource tree: a path is resolved to a resource here, and nowhere else (DESIGN "The resource tree")."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from pyoxigraph import NamedNode

from gateway.fleet.fleet import Fleet
from gateway.fleet.invocations import Invocations
from gateway.fleet.model import Joint, Link
from gateway.fleet.robot import Robot
from gateway.graph.actions import JointMotion
from gateway.graph.build import Graph
from gateway.graph.describe import Describer, joint_actions, part_paths
from gateway.graph.invocation import describe_invocation, describe_invocations, invocation_path
from gateway.graph.kinds import kind_of
from gateway.graph.paths import RESERVED_IN_ROBOT, joint_path, link_path, part_of, robot_name, robot_path
from gateway.graph.properties import FRAME_MEDIA_TYPE, Property, joint_properties, link_properties
from gateway.graph.shapes import blueprint, load
from gateway.graph.vocab import LDP, LF, PREFIXES


@dataclass(frozen=True)
class Resource:
    """One resource; ``describe`` adds its triples, ``documents`` are its other representations by media type."""

    path: str
    title: str
    describe: Callable[[Graph], None] | None
    interaction: tuple[NamedNode, ...] = (LDP.Resource, LDP.RDFSource)
    own: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    action: JointMotion | None = None
    documents: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)
    linkset_of: "Resource | None" = None
    has_linkset: bool = False

    @property
    def linkset(self) -> str:
        return self.path.rstrip("/") + "/linkset"


@dataclass(frozen=True)
class Redirect:
    """The one spelling of a path that has another (with or without the slash at its end)."""

    path: str


_CONTAINER = (LDP.Resource, LDP.BasicContainer)
Found = Resource | Redirect | None


class Tree:
    """Resolves paths against the live fleet, for descriptions under one base URL."""

    def __init__(self, fleet: Fleet, invocations: Invocations, base: str) -> None:
        self._fleet = fleet
        self._invocations = invocations
        self._say = Describer(base)
        self._base = base

    def resolve(self, path: str) -> Found:
        """The resource at ``path`` (percent-decoded, starting with a slash), its other spelling, or None."""
        if path == "/":
            return self._fleet_resource()
        head, *rest = path[1:].split("/")
        # Only such paths can name what the fleet itself owns; the links of all robots are made for nobody else.
        if rest in ([], [""]) and (found := self._at_root(head)) is not None:
            return Redirect(found.path) if rest else found
        try:
            robot = self._fleet.robots.get(robot_name(head))
        except ValueError:
            return None
        if robot is None:
            return None
        if not rest:
            return Redirect(robot_path(robot.name))
        if rest[-1] == "" and rest != [""]:
            other = path[:-1]
            if other.endswith("/"):
                return None
            return Redirect(other) if isinstance(self.resolve(other), Resource) else None
        return self._in_robot(robot, rest)

    # -- fleet ------------------------------------------------------------------------------------------------------

    def _fleet_resource(self) -> Resource:
        robots = tuple(robot_path(name) for name in sorted(self._fleet.robots))
        return Resource(
            "/",
            "Linked Fleet",
            lambda graph: self._say.fleet(self._fleet, graph),
            _CONTAINER,
            own=("/subscriptions", "/blueprint", "/vocabulary", "/context"),
            parts=robots,
            has_linkset=True,
        )

    def _at_root(self, segment: str) -> Resource | None:
        if segment == "vocabulary":
            return Resource("/vocabulary", "Vocabulary", _vocabulary)
        if segment == "context":
            context = json.dumps({"@context": PREFIXES}, indent=1).encode()
            document = {"application/ld+json": lambda: context}
            return Resource("/context", "JSON-LD context", None, (LDP.Resource,), documents=document)
        return self._of_thing(self._fleet_resource(), [segment], (LF.FleetShape,))

    # -- robot and its parts ----------------------------------------------------------------------------------------

    def _in_robot(self, robot: Robot, rest: list[str]) -> Found:
        # No part has a reserved segment, and the robot itself has a hundred links: only those who ask wait for them.
        if rest == [""] or rest[0] in RESERVED_IN_ROBOT:
            thing = self._robot_resource(robot)
            if rest == [""]:
                return thing
            own = self._property(robot, thing.path, self._say.robot_properties(robot), rest)
            return own or self._of_thing(thing, rest, (LF.RobotShape,))
        if robot.model is None:
            return None
        try:
            joint, link = part_of(rest[0], robot.model)
        except ValueError:
            return None
        if joint is not None:
            return self._in_joint(robot, robot.model.joints[joint], rest[1:])
        assert link is not None
        return self._in_link(robot, robot.model.links[link], rest[1:])

    def _robot_resource(self, robot: Robot) -> Resource:
        path = robot_path(robot.name)
        properties = self._say.robot_properties(robot) if robot.model else []
        return Resource(
            path,
            robot.name,
            lambda graph: self._say.robot(robot, graph),
            own=_own(path, properties),
            parts=tuple(part_paths(robot)),
            has_linkset=True,
        )

    def _in_joint(self, robot: Robot, joint: Joint, rest: list[str]) -> Found:
        path, properties = joint_path(robot.name, joint.name), joint_properties(robot, joint)
        actions = {name: JointMotion(robot, joint, name) for name in joint_actions(robot, joint)}
        own = _own(path, properties, tuple(action.path for action in actions.values()))
        thing = Resource(
            path, joint.name, lambda graph: self._say.joint(robot, joint, graph), own=own, has_linkset=True
        )
        if not rest:
            return thing
        if rest[0] == "actions" and len(rest) > 1 and rest[1] in actions:
            return self._in_action(robot, actions[rest[1]], rest[2:])
        shape = kind_of(joint).shape
        return self._of_thing(thing, rest, (shape,)) or self._property(robot, path, properties, rest)

    def _in_link(self, robot: Robot, link: Link, rest: list[str]) -> Found:
        assert robot.model is not None
        path, properties = link_path(robot.name, robot.model, link.name), link_properties(robot, link)
        thing = Resource(
            path,
            link.name,
            lambda graph: self._say.link(robot, link, graph),
            own=_own(path, properties),
            has_linkset=True,
        )
        if not rest:
            return thing
        return self._of_thing(thing, rest, (LF.LinkShape,)) or self._property(robot, path, properties, rest)

    # -- what things own --------------------------------------------------------------------------------------------

    def _of_thing(self, thing: Resource, rest: list[str], shapes: tuple[NamedNode, ...]) -> Resource | None:
        path = f"{thing.path.rstrip('/')}/{rest[0]}"
        if rest == ["subscriptions"]:
            title = f"Subscriptions of {thing.title}"
            return Resource(path, title, lambda graph: self._say.subscriptions(thing.path, graph), _CONTAINER)
        if rest == ["blueprint"]:
            return self._blueprint(path, thing.path, shapes)
        if rest == ["linkset"]:
            return Resource(path, f"Links of {thing.title}", None, (LDP.Resource,), linkset_of=thing)
        return None

    def _property(self, robot: Robot, owner: str, properties: list[Property], rest: list[str]) -> Resource | None:
        item = next((each for each in properties if each.segment == rest[0]), None)
        if item is None or len(rest) > 2 or rest[1:] not in ([], ["blueprint"]):
            return None
        path = f"{owner.rstrip('/')}/{item.segment}"
        if rest[1:]:
            return self._blueprint(path + "/blueprint", path, (item.shape,))
        documents: dict[str, Callable[[], bytes]] = {}
        if item.predicate == LF.jointState and robot.payload is not None:
            documents[FRAME_MEDIA_TYPE] = lambda: robot.payload or b""
        return Resource(
            path,
            item.title,
            lambda graph: self._say.property(robot, owner, item, graph),
            own=(path + "/blueprint",),
            documents=documents,
        )

    def _blueprint(self, path: str, owner: str, shapes: tuple[NamedNode, ...]) -> Resource:
        iri, target = self._say.iri(path), self._say.iri(owner)
        return Resource(path, f"Blueprint of {owner}", lambda graph: blueprint(graph, iri, target, shapes))

    def _in_action(self, robot: Robot, action: JointMotion, rest: list[str]) -> Resource | None:
        path = action.path
        if not rest:
            own = (path + "/produceshape", path + "/invocations")
            # Neither an LDP resource nor a container: its PUT does not replace state, its POST creates no member.
            return Resource(
                path, action.title, lambda graph: action.describe(graph, self._base), (), own=own, action=action
            )
        if rest == ["produceshape"]:
            title = f"Shape of what {action.name} produces"
            return Resource(path + "/produceshape", title, lambda graph: action.describe_result(graph, self._base))
        if rest[0] != "invocations":
            return None
        if len(rest) == 1:
            members = self._invocations.of(path)
            return Resource(
                path + "/invocations",
                f"Invocations of {action.title}",
                lambda graph: describe_invocations(graph, self._base, path, members),
                _CONTAINER,
                own=tuple(invocation_path(each) for each in members),
            )
        invocation = self._invocations.get(rest[1])
        if len(rest) > 2 or invocation is None or invocation.action != path:
            return None
        title = f"Invocation {invocation.id}"
        return Resource(
            invocation_path(invocation), title, lambda graph: describe_invocation(graph, self._base, robot, invocation)
        )


def _own(path: str, properties: list[Property], actions: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Sub-resources in the order of DESIGN's Link row: subscriptions, blueprint, actions, properties."""
    stem = path.rstrip("/")
    return (stem + "/subscriptions", stem + "/blueprint", *actions, *(f"{stem}/{each.segment}" for each in properties))


def _vocabulary(graph: Graph) -> None:
    for triples in load("vocabulary.ttl").values():
        for triple in triples:
            graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]
