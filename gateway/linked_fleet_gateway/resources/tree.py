"""The resource tree, the only place where a path is resolved to a resource (docs/TREE.md)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from types import MappingProxyType

from pyoxigraph import NamedNode

from linked_fleet_gateway.fleet.fleet import Fleet
from linked_fleet_gateway.fleet.invocations import FLEET, Invocations
from linked_fleet_gateway.fleet.model import Joint, Link
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.identity.rights import ALL, View
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.vocabulary import LDP, LF
from linked_fleet_gateway.resources.access_filter import InvocationsInView, RobotsInView
from linked_fleet_gateway.resources.action_offer import Offer, fleet_offers, joint_offers, robot_offers
from linked_fleet_gateway.resources.action_tree import in_actions, invocation_of
from linked_fleet_gateway.resources.affordance import Control
from linked_fleet_gateway.resources.battery import battery_charge
from linked_fleet_gateway.resources.binary_frames import frames_of, in_layout, is_framed, layout_path, related_layouts
from linked_fleet_gateway.resources.branches import NONE, Branches, Found, RequestView
from linked_fleet_gateway.resources.describe import Describer, Doing, last_frame, part_paths
from linked_fleet_gateway.resources.documents import context, in_geometry, vocabulary
from linked_fleet_gateway.resources.invocation import invocation_path
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.lease import describe_lease
from linked_fleet_gateway.resources.paths import (
    is_below,
    joint_path,
    lease_path,
    link_path,
    model_path,
    part_of,
    reserved_at_root,
    reserved_in_robot,
    robot_name,
    robot_path,
)
from linked_fleet_gateway.resources.plain_json import with_json
from linked_fleet_gateway.resources.properties import joint_properties, link_properties
from linked_fleet_gateway.resources.property import Look, Property, Seen
from linked_fleet_gateway.resources.resource import CONTAINER, Redirect, Resource, blueprint_of
from linked_fleet_gateway.resources.settable import affordance, describe_target_blueprint
from linked_fleet_gateway.resources.subscription import Record
from linked_fleet_gateway.resources.subscription_resource import in_subscriptions
from linked_fleet_gateway.resources.versioning import Source, presence

Shelf = Mapping[str, Sequence[Record]]
"""Subscriptions by the path of their owner, as far as they have been fetched."""
EMPTY: Shelf = MappingProxyType({})
_OF_THINGS = ("subscriptions", "blueprint", "linkset")


class Tree:
    """Resolves paths for what ``sees`` shows of the live fleet, for descriptions under one base URL."""

    def __init__(
        self,
        fleet: Fleet,
        invocations: Invocations,
        base: str,
        shelf: Shelf = EMPTY,
        sees: View = ALL,
        branches: Branches = NONE,
        secured: bool = False,
    ) -> None:
        self._robots: Mapping[str, Robot] = fleet.robots if sees.all else RobotsInView(fleet.robots, sees)
        self._invocations = InvocationsInView(invocations, sees)
        self._shelf = shelf
        self._say = Describer(base)
        self._base = base
        self._branches = branches
        self._view = RequestView(base, self._robots, self._invocations, sees, secured)

    def resolve(self, path: str) -> Found:
        """Return the resource at ``path`` (percent-decoded, with leading slash), a redirect to its canonical path, or
        None.
        """
        if path == "/":
            return self._fleet_resource()
        head, *rest = path[1:].split("/")
        # Only these paths can be resources of the fleet itself, whose links to all robots are costly.
        reserved = head in reserved_at_root() and rest in ([], [""])
        if reserved and (found := self._at_root(head)) is not None:
            return Redirect(found.path) if rest else found
        if head == "subscriptions":
            return self._of_thing(self._fleet_resource(), [head, *rest], ())
        if (branch := self._branches.at_root(head)) is not None:
            return branch.resolve(self._view, rest)
        if head == "actions" and rest:
            return in_actions(fleet_offers(), rest, self._invocations, Source(), self._base)
        try:
            robot = self._robots.get(robot_name(head))
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
        robots = tuple(robot_path(name) for name in sorted(self._robots))
        return Resource(
            "/",
            "Linked Fleet",
            lambda graph: self._say.fleet(self._robots, self._branches.linked(), graph, self._doing),
            CONTAINER,
            # The last-seen time of a robot differs between gateways.
            Source(
                self._members, digest=lambda: [(*named, here, fault) for *named, (here, _, fault) in self._members()]
            ),
            own=(
                *("/subscriptions", "/blueprint", *(each.path for each in fleet_offers()), "/vocabulary", "/context"),
                *(path for _, path in self._branches.linked()),
            ),
            parts=robots,
            links=self._branches.links(),
            documents=self._branches.of_thing(self._view),
            constant=self._branches.constant,
            has_linkset=True,
        )

    def _members(self) -> list[tuple[str, str, str, Doing, tuple[str, int | None, str | None]]]:
        return [
            (name, robot.title, robot.model.name if robot.model else "", self._doing(robot), presence(robot))
            for name, robot in self._robots.items()
        ]

    def _doing(self, robot: Robot) -> Doing:
        moved_ns = self._invocations.last_motion_ns(robot.name)
        return Doing(tuple(self._tasks(robot)), moved_ns, battery_charge(robot))

    def _at_root(self, segment: str) -> Resource | None:
        if segment == "vocabulary":
            return vocabulary(self._base)
        if segment == "context":
            return context()
        return self._of_thing(self._fleet_resource(), [segment], (LF.FleetShape,))

    # -- robot and its parts ----------------------------------------------------------------------------------------

    def _in_robot(self, robot: Robot, rest: list[str]) -> Found:
        # Reserved segments are not parts. The robot's own resource, with its hundred links, is built only when needed.
        if rest == [""] or rest[0] in reserved_in_robot():
            if rest == [""] or rest[0] in _OF_THINGS:
                thing = self._robot_resource(robot)
                return thing if rest == [""] else self._of_thing(thing, rest, (LF.RobotShape,))
            if (branch := self._branches.in_robot(robot, rest[0])) is not None:
                return branch.resolve(self._view, robot, rest[1:])
            own = self._of_robot(robot, rest) or in_geometry(robot, rest, self._base)
            return own or self._property(robot, robot_path(robot.name), self._say.robot_properties(robot), rest)
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

    def _of_robot(self, robot: Robot, rest: list[str]) -> Resource | None:
        """Return resources that only robots have: actions of several joints, and the control lease."""
        if rest[0] == "actions" and len(rest) > 1:
            return in_actions(robot_offers(robot), rest[1:], self._invocations, _about(robot), self._base)
        if rest[0] != "lease":
            return None
        path = lease_path(robot.name)
        lease = Resource(
            path,
            f"Control of {robot.name}",
            lambda graph: describe_lease(graph, self._base, robot),
            source=Source(lambda: robot.lease, robot=robot),
            own=(path + "/blueprint",),
            affords=Control(robot),
        )
        if rest[1:] == ["blueprint"]:
            return blueprint_of(lease, self._base, (LF.ControlLeaseShape,))
        return None if rest[1:] else lease

    def _robot_resource(self, robot: Robot) -> Resource:
        path = robot_path(robot.name)
        properties = self._say.robot_properties(robot) if robot.model else []
        actions = (*(each.path for each in robot_offers(robot)), lease_path(robot.name))
        actions += (model_path(robot.name),) if robot.model else ()
        branches = self._branches.linked_from(robot, path)
        actions += tuple(found for _, found in branches)
        return Resource(
            path,
            robot.name,
            lambda graph: self._say.robot(robot, self._tasks(robot), branches, graph),
            measured=lambda graph, seens: self._say.robot(robot, self._tasks(robot), branches, graph, seens),
            looks=_looks(properties),
            quiet=(lambda: last_frame(robot),),
            source=_thing(robot, properties, lambda: (self._tasks(robot), self._branches.linked_from(robot, path))),
            own=_own(path, properties, actions),
            parts=tuple(part_paths(robot)),
            documents=self._branches.of_thing(self._view, robot),
            constant=self._branches.constant,
            has_linkset=True,
        )

    def _tasks(self, robot: Robot) -> list[str]:
        """Return the paths of the robot's running invocations (D4)."""
        return [invocation_path(each) for each in self._invocations.open_of(robot.name)]

    def _in_joint(self, robot: Robot, joint: Joint, rest: list[str]) -> Found:
        if rest[:1] == ["actions"] and len(rest) > 1:
            return in_actions(joint_offers(robot, joint), rest[1:], self._invocations, _about(robot), self._base)
        if not rest or rest[0] in _OF_THINGS:
            thing = self._joint(robot, joint)
            return self._of_thing(thing, rest, (kind_of(joint).shape,)) if rest else thing
        return self._property(robot, joint_path(robot.name, joint.name), joint_properties(robot, joint), rest)

    def _joint(self, robot: Robot, joint: Joint) -> Resource:
        path, properties = joint_path(robot.name, joint.name), joint_properties(robot, joint)
        actions = tuple(each.path for each in joint_offers(robot, joint))
        return Resource(
            path,
            joint.name,
            lambda graph: self._say.joint(robot, joint, graph),
            measured=lambda graph, seens: self._say.joint(robot, joint, graph, seens),
            looks=_looks(properties),
            source=_thing(robot, properties),
            own=_own(path, properties, actions),
            documents=self._branches.of_thing(self._view, robot, joint),
            constant=self._branches.constant,
            has_linkset=True,
        )

    def _in_link(self, robot: Robot, link: Link, rest: list[str]) -> Found:
        if not rest or rest[0] in _OF_THINGS:
            thing = self._link(robot, link)
            return self._of_thing(thing, rest, (LF.LinkShape,)) if rest else thing
        assert robot.model is not None
        path = link_path(robot.name, robot.model, link.name)
        return self._property(robot, path, link_properties(robot, link), rest)

    def _link(self, robot: Robot, link: Link) -> Resource:
        assert robot.model is not None
        path, properties = link_path(robot.name, robot.model, link.name), link_properties(robot, link)
        return Resource(
            path,
            link.name,
            lambda graph: self._say.link(robot, link, graph),
            measured=lambda graph, seens: self._say.link(robot, link, graph, seens),
            looks=_looks(properties),
            source=_thing(robot, properties),
            own=_own(path, properties),
            documents=self._branches.of_thing(self._view, robot, link),
            constant=self._branches.constant,
            has_linkset=True,
        )

    # -- what things own --------------------------------------------------------------------------------------------

    def _of_thing(self, thing: Resource, rest: list[str], shapes: tuple[NamedNode, ...]) -> Resource | None:
        path = f"{thing.path.rstrip('/')}/{rest[0]}"
        if rest[0] == "subscriptions":
            return in_subscriptions(thing, rest[1:], self._shelf.get(thing.path, ()), self._base)
        if rest == ["blueprint"]:
            return blueprint_of(thing, self._base, shapes, _following(thing.source))
        if rest == ["linkset"]:
            return Resource(path, f"Links of {thing.title}", None, (LDP.Resource,), linkset_of=thing)
        return None

    def _property(self, robot: Robot, owner: str, properties: list[Property], rest: list[str]) -> Found:
        item = next((each for each in properties if each.segment == rest[0]), None)
        if item is None:
            return None
        if rest[1:] not in ([], ["blueprint"]):
            branch = self._branches.below_property(item, rest[1])
            if branch is not None:
                return branch.resolve(self._view, robot, owner, item, rest[2:])
            return in_layout(self._say, robot, owner, item, rest[1:])
        resource = self._measurement(robot, owner, item)
        if not rest[1:]:
            return resource
        whole = blueprint_of(resource, self._base, (item.shape,), _following(resource.source))
        if not isinstance(item.put, Offer):
            return whole
        return replace(whole, describe=partial(describe_target_blueprint, whole, item.put, self._base), alike=None)

    def _measurement(self, robot: Robot, owner: str, item: Property) -> Resource:
        path = f"{owner.rstrip('/')}/{item.segment}"
        # A new description is no change of a value unless its model differs, which holds the constants.
        source = Source(lambda: (presence(robot), robot.model, item.facts(), robot.settings), item.look, robot)

        def measured(graph: Graph, seens: Sequence[Seen]) -> None:
            self._say.property(robot, owner, item, graph, seens[0])

        resource = Resource(
            path,
            item.title,
            lambda graph: measured(graph, [Seen.of(item.look())]),
            measured=measured if item.measured else None,
            looks=(item.look,) if item.measured else (),
            source=source,
            own=(path + "/blueprint", *related_layouts(path, item), *self._branches.related_to(path, item)),
            documents=frames_of(robot, item),
            layout=layout_path(path) if is_framed(item) else None,
            affords=affordance(item.put),
        )
        return with_json(resource, item.shape, self._base)

    # -- all that is below ------------------------------------------------------------------------------------------

    def below(self, path: str) -> Iterator[tuple[Resource, bool]]:
        """Yield the resources that a subtree subscription to ``path`` covers, and True if their values count as change.

        Each value occurs once: a thing has its own statements, followed by each property. The joint state is omitted,
        because it repeats the values of joints. Invocations are included until they have ended.
        """
        root = self.resolve(path)
        if not isinstance(root, Resource):
            return
        yield root, path != root.owner
        if path == "/":
            for name in self._robots:
                yield from self.below(robot_path(name))
            for invocation in self._invocations.open_of(FLEET):
                yield invocation_of(None, invocation, self._invocations, self._base), True
        elif path == root.owner:
            yield from self._below_thing(root)

    def _below_thing(self, root: Resource) -> Iterator[tuple[Resource, bool]]:
        head, part = root.path[1:].split("/")
        robot = self._robots[robot_name(head)]
        if robot.model is not None:
            joint, link = (None, None) if not part else part_of(part, robot.model)
            for thing, properties in self._things(robot, joint, link):
                if thing.path != root.path:
                    yield thing, False
                for item in properties:
                    yield self._measurement(robot, thing.path, item), True
        for invocation in self._invocations.open_of(robot.name):
            if is_below(invocation.action, root.path):
                yield invocation_of(robot, invocation, self._invocations, self._base), True

    def _things(
        self, robot: Robot, joint: str | None, link: str | None
    ) -> Iterator[tuple[Resource, Sequence[Property]]]:
        """Yield one joint or link with its properties, or the robot with all of its parts."""
        assert robot.model is not None
        if joint is None and link is None:
            own = [each for each in self._say.robot_properties(robot) if each.predicate != LF.jointState]
            yield self._robot_resource(robot), own
        for each in robot.model.joints.values():
            if link is None and joint in (None, each.name):
                yield self._joint(robot, each), joint_properties(robot, each)
        for one in robot.model.links.values():
            if joint is None and link in (None, one.name):
                yield self._link(robot, one), link_properties(robot, one)

    def may_come(self, path: str) -> bool:
        """Return True if a resource may exist at ``path`` once its robot has described itself."""
        try:
            robot = self._robots.get(robot_name(path[1:].partition("/")[0]))
        except ValueError:
            return False
        return robot is not None and robot.model is None


def _thing(robot: Robot, properties: Sequence[Property], also: Callable[[], object] = tuple) -> Source:
    """Return the source of a thing, which changes with its properties' values and with its robot's description."""
    looks = _looks(properties)
    look = (lambda: tuple(chain.from_iterable(look() for look in looks))) if looks else tuple
    facts = [each.facts for each in properties if each.facts is not tuple]
    return Source(
        lambda: (presence(robot), robot.description, robot.settings, also(), [fact() for fact in facts]), look, robot
    )


def _looks(properties: Sequence[Property]) -> tuple[Look, ...]:
    return tuple([each.look for each in properties if each.measured])


def _following(source: Source) -> Source:
    """Return the source of a resource that depends on the description only."""
    return Source() if source.robot is None else _about(source.robot)


def _about(robot: Robot) -> Source:
    return Source(lambda: (robot.description, robot.annotations), robot=robot)


def _own(path: str, properties: list[Property], actions: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return sub-resources in the order of the Link field: subscriptions, blueprint, actions, properties."""
    stem = path.rstrip("/")
    return (stem + "/subscriptions", stem + "/blueprint", *actions, *(f"{stem}/{each.segment}" for each in properties))
