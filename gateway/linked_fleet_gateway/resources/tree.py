"""The resource tree, the only place where a path is resolved to a resource (docs/TREE.md)."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

from pyoxigraph import NamedNode

from linked_fleet_base.faults import Faults
from linked_fleet_gateway.resources.access_filter import InvocationsInView, RobotsInView
from linked_fleet_gateway.resources.action_offer import fleet_offers, joint_offers, robot_offers
from linked_fleet_gateway.resources.action_tree import invocation_of, resolve_action
from linked_fleet_gateway.resources.binary_frames import resolve_layout
from linked_fleet_gateway.resources.branches import NO_BRANCHES, Branches, Found, RequestView
from linked_fleet_gateway.resources.documents import context_resource, vocabulary_resource
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.part import RobotPart, parts_of
from linked_fleet_gateway.resources.paths import (
    is_below,
    joint_or_link,
    joint_path,
    link_path,
    reserved_at_root,
    reserved_in_robot,
    robot_name,
    robot_path,
)
from linked_fleet_gateway.resources.properties import joint_properties, link_properties
from linked_fleet_gateway.resources.property import Property
from linked_fleet_gateway.resources.resource import Redirect, Resource, blueprint_at, blueprint_of
from linked_fleet_gateway.resources.things import NO_SUBSCRIPTIONS, SubscriptionsByOwner, Things, description_source
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_identity.rights import ALL, View
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import FLEET, Invocations
from linked_fleet_state.model import Joint, Link, RobotModel
from linked_fleet_state.robot import Robot

_OF_THINGS = ("subscriptions", "blueprint", "linkset")


class Tree:
    """Resolves paths to resources of ``visible_robots``, for descriptions under one base URL."""

    def __init__(
        self,
        fleet: Fleet,
        invocations: Invocations,
        base: str,
        subscriptions: SubscriptionsByOwner = NO_SUBSCRIPTIONS,
        visible_robots: View = ALL,
        branches: Branches = NO_BRANCHES,
        requires_authentication: bool = False,
        faults: Faults | None = None,
    ) -> None:
        self._robots: Mapping[str, Robot] = (
            fleet.robots if visible_robots.includes_all else RobotsInView(fleet.robots, visible_robots)
        )
        self._invocations = InvocationsInView(invocations, visible_robots)
        self._base = base
        self._branches = branches
        self.view = RequestView(
            base, self._robots, self._invocations, visible_robots, requires_authentication, faults or Faults()
        )
        self._things = Things(self.view, branches, subscriptions)

    def resolve(self, path: str) -> Found:
        """Return the resource at ``path`` (percent-decoded, with leading slash), a redirect to its canonical path, or
        None.
        """
        found = self._resolve(path)
        if found is not None or not path.endswith("/") or path.endswith("//"):
            return found
        return Redirect(path[:-1]) if isinstance(self._resolve(path[:-1]), Resource) else None

    def _resolve(self, path: str) -> Found:
        if path == "/":
            return self._things.fleet()
        head, *rest = path[1:].split("/")
        # Only these paths can be resources of the fleet itself, whose links to all robots are costly.
        if head in reserved_at_root() and not rest and (found := self._at_root(head)) is not None:
            return found
        if head == "subscriptions":
            return self._things.owned_resource(self._things.fleet(), [head, *rest], ())
        if (branch := self._branches.fleet_branch(head)) is not None:
            return branch.resolve(self.view, rest)
        if head == "actions" and rest:
            return resolve_action(fleet_offers(rest[0]), rest, self._invocations, Source(), self._base)
        try:
            robot = self._robots.get(robot_name(head))
        except ValueError:
            return None
        if robot is None:
            return None
        if not rest:
            return Redirect(robot_path(robot.name))
        return None if rest[-1] == "" and rest != [""] else self._in_robot(robot, rest)

    # -- fleet ------------------------------------------------------------------------------------------------------

    def _at_root(self, segment: str) -> Resource | None:
        if segment == "vocabulary":
            return vocabulary_resource(self._base)
        if segment == "context":
            return context_resource()
        return self._things.owned_resource(self._things.fleet(), [segment], (LF.FleetShape,))

    # -- robot and its parts ----------------------------------------------------------------------------------------

    def _in_robot(self, robot: Robot, rest: list[str]) -> Found:
        # Reserved segments are not parts. The robot's own resource, with its hundred links, is built only when needed.
        if rest == [""] or rest[0] in reserved_in_robot():
            if rest == ["blueprint"]:
                return self._blueprint(robot, robot_path(robot.name), LF.RobotShape)
            if rest == [""] or rest[0] in _OF_THINGS:
                thing = self._things.robot(robot)
                return thing if rest == [""] else self._things.owned_resource(thing, rest, (LF.RobotShape,))
            if (branch := self._branches.robot_branch(robot, rest[0])) is not None:
                return branch.resolve(self.view, robot, rest[1:])
            return self._of_robot(robot, rest) or self._property(
                robot, robot_path(robot.name), self._things.describer.robot_properties(robot), rest
            )
        if robot.model is None:
            return None
        if (part := parts_of(robot).get(rest[0])) is not None:
            return self._in_part(part, rest[1:])
        try:
            joint, link = joint_or_link(rest[0], robot.model)
        except ValueError:
            return None
        if joint is not None:
            return self._in_joint(robot, robot.model.joints[joint], rest[1:])
        assert link is not None
        return self._in_link(robot, robot.model.links[link], rest[1:])

    def _of_robot(self, robot: Robot, rest: list[str]) -> Resource | None:
        """Return resources that only robots have: actions of several joints, and the control lease."""
        if rest[0] == "actions" and len(rest) > 1:
            return resolve_action(
                robot_offers(robot, rest[1]), rest[1:], self._invocations, description_source(robot), self._base
            )
        if rest[0] != "lease":
            return None
        lease = self._things.lease(robot)
        if rest[1:] == ["blueprint"]:
            return blueprint_of(lease, self._base, (LF.ControlLeaseShape,))
        return None if rest[1:] else lease

    def _in_joint(self, robot: Robot, joint: Joint, rest: list[str]) -> Found:
        if rest[:1] == ["actions"] and len(rest) > 1:
            return resolve_action(
                joint_offers(robot, joint, rest[1]), rest[1:], self._invocations, description_source(robot), self._base
            )
        path = joint_path(robot.name, joint.name)
        if rest == ["blueprint"]:
            return self._blueprint(robot, path, kind_of(joint).shape)
        if not rest or rest[0] in _OF_THINGS:
            thing = self._things.joint(robot, joint)
            return self._things.owned_resource(thing, rest, (kind_of(joint).shape,)) if rest else thing
        return self._property(robot, path, joint_properties(robot, joint, rest[0]), rest)

    def _in_link(self, robot: Robot, link: Link, rest: list[str]) -> Found:
        assert robot.model is not None
        path = link_path(robot.name, robot.model, link.name)
        if rest == ["blueprint"]:
            return self._blueprint(robot, path, LF.LinkShape)
        if not rest or rest[0] in _OF_THINGS:
            thing = self._things.link(robot, link)
            return self._things.owned_resource(thing, rest, (LF.LinkShape,)) if rest else thing
        return self._property(robot, path, link_properties(robot, link, rest[0]), rest)

    def _in_part(self, part: RobotPart, rest: list[str]) -> Found:
        if rest[:1] == ["actions"] and len(rest) > 1:
            offers = [part.offers[rest[1]]] if rest[1] in part.offers else []
            source = description_source(part.robot)
            return resolve_action(offers, rest[1:], self._invocations, source, self._base)
        if not rest or rest[0] in _OF_THINGS:
            thing = self._things.part(part)
            return self._things.owned_resource(thing, rest, tuple(part.shapes)) if rest else thing
        return self._property(part.robot, part.path, part.properties(self._base), rest)

    def _blueprint(self, robot: Robot, path: str, shape: NamedNode) -> Resource:
        return blueprint_at(path, self._base, (shape,), description_source(robot))

    # -- what things own --------------------------------------------------------------------------------------------

    def _property(self, robot: Robot, owner: str, properties: Sequence[Property], rest: list[str]) -> Found:
        item = next((each for each in properties if each.segment == rest[0]), None)
        if item is None:
            return None
        if rest[1:] not in ([], ["blueprint"]):
            branch = self._branches.property_branch(item, rest[1])
            if branch is not None:
                return branch.resolve(self.view, robot, owner, item, rest[2:])
            return resolve_layout(self._things.describer, robot, owner, item, rest[1:])
        if not rest[1:]:
            return self._things.property(robot, owner, item)
        return self._things.property_blueprint(robot, owner, item)

    # -- all that is below ------------------------------------------------------------------------------------------

    def subtree(self, path: str) -> Iterator[tuple[Resource, bool]]:
        """Yield the resources that a subtree subscription to ``path`` covers, and True if their values count as change.

        Each value occurs once: a thing has its own statements, followed by each property. The joint state is omitted,
        because it repeats the values of joints. Invocations are included until they have ended. If another description
        of a robot comes between two steps, its further parts are left out.
        """
        root = self.resolve(path)
        if not isinstance(root, Resource):
            return
        below = self._below(root) if path == root.owner_path != "/" else iter(())
        yield root, path != root.owner_path
        yield from below
        if path == "/":
            for name in self._robots:
                yield from self.subtree(robot_path(name))
            for invocation in self._invocations.open_of_robot(FLEET):
                yield invocation_of(None, invocation, self._invocations, self._base), True

    def _below(self, root: Resource) -> Iterator[tuple[Resource, bool]]:
        """Return what is below a robot, joint or link."""
        head, part = root.path[1:].split("/")
        robot = self._robots[robot_name(head)]
        if robot.model is None:
            return self._open_below(root, robot)
        if (added := parts_of(robot).get(part)) is not None:
            parts = self._in_parts(root, robot, iter([(self._things.part(added), added.properties(self._base))]))
            return chain(_while_described(robot, robot.model, parts), self._open_below(root, robot))
        joint, link = (None, None) if not part else joint_or_link(part, robot.model)
        parts = self._in_parts(root, robot, self._parts(robot, robot.model, joint, link))
        return chain(_while_described(robot, robot.model, parts), self._open_below(root, robot))

    def _in_parts(
        self, root: Resource, robot: Robot, parts: Iterator[tuple[Resource, Sequence[Property]]]
    ) -> Iterator[tuple[Resource, bool]]:
        for thing, properties in parts:
            if thing.path != root.path:
                yield thing, False
            for item in properties:
                yield self._things.property(robot, thing.path, item), True

    def _open_below(self, root: Resource, robot: Robot) -> Iterator[tuple[Resource, bool]]:
        for invocation in self._invocations.open_of_robot(robot.name):
            if is_below(invocation.action, root.path):
                yield invocation_of(robot, invocation, self._invocations, self._base), True

    def _parts(
        self, robot: Robot, model: RobotModel, joint: str | None, link: str | None
    ) -> Iterator[tuple[Resource, Sequence[Property]]]:
        """Yield one joint or link with its properties, or the robot with all of its parts."""
        if joint is None and link is None:
            own = [each for each in self._things.describer.robot_properties(robot) if each.predicate != LF.jointState]
            yield self._things.robot(robot), own
        for each in model.joints.values():
            if link is None and joint in (None, each.name):
                yield self._things.joint(robot, each), joint_properties(robot, each)
        for one in model.links.values():
            if joint is None and link in (None, one.name):
                yield self._things.link(robot, one), link_properties(robot, one)
        for added in parts_of(robot).values() if joint is None and link is None else ():
            yield self._things.part(added), added.properties(self._base)

    def may_appear(self, path: str) -> bool:
        """Return True if a resource may exist at ``path`` once its robot has described itself."""
        try:
            robot = self._robots.get(robot_name(path[1:].partition("/")[0]))
        except ValueError:
            return False
        return robot is not None and robot.model is None


def _while_described(
    robot: Robot, model: RobotModel, steps: Iterator[tuple[Resource, bool]]
) -> Iterator[tuple[Resource, bool]]:
    """Yield the steps while the robot has this model, by which they were made."""
    while robot.model is model and (step := next(steps, None)) is not None:
        yield step
