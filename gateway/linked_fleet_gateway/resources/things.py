"""The resources of the fleet, of robots, joints and links, of their properties, and those that each thing owns."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from decimal import Decimal
from itertools import chain
from types import MappingProxyType

from msgspec import structs
from pyoxigraph import NamedNode

from linked_fleet_gateway.resources.action_offer import Offer, fleet_offers, joint_offers, robot_offers
from linked_fleet_gateway.resources.affordance import Control, ForgetRobot
from linked_fleet_gateway.resources.annotations import battery_charge
from linked_fleet_gateway.resources.binary_frames import frame_writers, has_frames, layout_path, related_layouts
from linked_fleet_gateway.resources.branches import Branches, RequestView
from linked_fleet_gateway.resources.describe import Describer, RobotActivity, Task, last_frame, part_paths
from linked_fleet_gateway.resources.description import InSteps, MeasuredDescription, run_steps
from linked_fleet_gateway.resources.invocation import describe_lease, invocation_path
from linked_fleet_gateway.resources.part import RobotPart, parts_of
from linked_fleet_gateway.resources.paths import joint_path, lease_path, link_path, robot_path
from linked_fleet_gateway.resources.plain_json import add_plain_json
from linked_fleet_gateway.resources.properties import joint_properties, link_properties
from linked_fleet_gateway.resources.property import Measurement, Property, Sampler, added_introductions
from linked_fleet_gateway.resources.resource import CONTAINER, Resource, blueprint_at, blueprint_of
from linked_fleet_gateway.resources.settable import put_affordance, target_blueprint
from linked_fleet_gateway.resources.subscription import Record
from linked_fleet_gateway.resources.subscription_resource import resolve_subscription
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.vocabulary import LDP
from linked_fleet_state.model import Joint, Link
from linked_fleet_state.robot import Robot

MAX_AT_ONCE = 16
"""Robots that are described in one step, and whose list may be kept while what it shows is the same."""
SubscriptionsByOwner = Mapping[str, Sequence[Record]]
"""Subscriptions by the path of their owner, as far as they have been fetched."""
NO_SUBSCRIPTIONS: SubscriptionsByOwner = MappingProxyType({})


class Things:
    """Builds the resources of one view of the fleet."""

    def __init__(self, view: RequestView, branches: Branches, subscriptions: SubscriptionsByOwner) -> None:
        self.describer = Describer(view.base)
        self._view, self._branches, self._subscriptions = view, branches, subscriptions

    def fleet(self) -> Resource:
        """Return the fleet, which links all robots."""
        robots = tuple(robot_path(name) for name in sorted(self._view.robots))
        return Resource(
            "/",
            "Linked Fleet",
            InSteps(self._describe_fleet) if len(robots) > MAX_AT_ONCE else self._describe_small_fleet,
            CONTAINER,
            # The last-seen time of a robot differs between gateways.
            Source(
                self._members,
                shared_facts=lambda: [(*named, here, fault) for *named, (here, _, fault) in self._members()],
                shown=self._shown if len(robots) <= MAX_AT_ONCE else None,
            ),
            own_paths=(
                *("/subscriptions", "/blueprint", *(each.path for each in fleet_offers()), "/vocabulary", "/context"),
                *(path for _, path in self._branches.fleet_links()),
            ),
            part_paths=robots,
            typed_links=self._branches.typed_links(),
            documents=self._branches.thing_documents(self._view),
            has_linkset=True,
            has_form=True,
        )

    def _shown(self) -> object:
        faults = self._view.faults
        return self._members(), faults.of_parts, [faults.find("the fleet", name) for name in self._view.robots]

    def _describe_small_fleet(self, graph: Graph) -> None:
        run_steps(self._describe_fleet(graph))

    def _describe_fleet(self, graph: Graph) -> Iterator[None]:
        links = self._branches.fleet_links()
        return self.describer.fleet(self._view.robots, links, graph, self._activity, self._view.faults)

    def _members(self) -> list[tuple[str, str, str, RobotActivity, tuple[str, int | None, str | None]]]:
        return [
            (name, robot.title, robot.model.name if robot.model else "", self._activity(robot), robot.presence_facts)
            for name, robot in self._view.robots.items()
        ]

    def _activity(self, robot: Robot) -> RobotActivity:
        # What frames show counts; before them, as after a restart, the end of the last commanded motion is known.
        moved_ns = self._view.invocations.last_motion_ns(robot.name) if robot.moved_ns is None else robot.moved_ns
        ended_ns = None if robot.moving else moved_ns
        tasks = tuple(
            Task(invocation_path(each), each.client, int(10 * each.progress))
            for each in self._view.invocations.open_of_robot(robot.name)
        )
        holder = "" if robot.lease is None else robot.lease.holder
        more = tuple(said for add in added_introductions() for said in add(robot))
        return RobotActivity(tasks, ended_ns, _battery_percent(robot), robot.moving, holder, more, robot.link_quality)

    def robot(self, robot: Robot) -> Resource:
        """Return a robot, which links its parts, properties and actions."""
        path = robot_path(robot.name)
        properties = self.describer.robot_properties(robot) if robot.model else []
        actions = (*(each.path for each in robot_offers(robot)), lease_path(robot.name))
        branches = self._branches.robot_links(robot, path)
        actions += tuple(found for _, found in branches)
        return Resource(
            path,
            robot.name,
            MeasuredDescription(
                lambda graph, seen: self.describer.robot(robot, self._tasks(robot), branches, graph, seen),
                _samplers(properties),
                silent=(lambda: last_frame(robot),),
            ),
            source=_thing(robot, properties, lambda: self._changing(robot, path)),
            own_paths=_own(path, properties, actions),
            part_paths=tuple(part_paths(robot)),
            affords=ForgetRobot(robot),
            documents=self._branches.thing_documents(self._view, robot),
            has_linkset=True,
        )

    def _changing(self, robot: Robot, path: str) -> tuple[object, ...]:
        """Return what its description contains beside its properties."""
        return self._tasks(robot), self._branches.robot_links(robot, path), robot.unchecked, robot.kept_poses

    def _tasks(self, robot: Robot) -> list[str]:
        """Return the paths of the robot's running invocations (D4)."""
        return [invocation_path(each) for each in self._view.invocations.open_of_robot(robot.name)]

    def joint(self, robot: Robot, joint: Joint) -> Resource:
        """Return a joint of the robot."""
        path, properties = joint_path(robot.name, joint.name), joint_properties(robot, joint)
        actions = tuple(each.path for each in joint_offers(robot, joint))
        return Resource(
            path,
            joint.name,
            MeasuredDescription(
                lambda graph, seen: self.describer.joint(robot, joint, graph, seen), _samplers(properties)
            ),
            source=_thing(robot, properties),
            own_paths=_own(path, properties, actions),
            documents=self._branches.thing_documents(self._view, robot, joint),
            has_linkset=True,
        )

    def link(self, robot: Robot, link: Link) -> Resource:
        """Return a link of the robot."""
        assert robot.model is not None
        path, properties = link_path(robot.name, robot.model, link.name), link_properties(robot, link)
        return Resource(
            path,
            link.name,
            MeasuredDescription(
                lambda graph, seen: self.describer.link(robot, link, graph, seen), _samplers(properties)
            ),
            source=_thing(robot, properties),
            own_paths=_own(path, properties),
            documents=self._branches.thing_documents(self._view, robot, link),
            has_linkset=True,
        )

    def part(self, part: RobotPart) -> Resource:
        """Return another part of a robot."""
        items = part.properties(self._view.base)
        measured = [each for each in items if each.is_measured]
        counters = [each.counter for each in items if each.counter is not None]
        source = _thing(part.robot, items, part.facts)
        return Resource(
            part.path,
            part.name,
            InSteps(lambda graph: self.describer.part_in_steps(part, items, graph))
            if any(each.is_long() for each in items)
            else MeasuredDescription(
                lambda graph, seen: self.describer.part(part, items, graph, seen), _samplers(measured)
            ),
            source=structs.replace(source, counter=lambda: sum(count() for count in counters)),
            own_paths=_own(part.path, items, tuple(each.path for each in part.offers.values())),
            documents={**self._branches.thing_documents(self._view, part.robot, part), JSON: part.json},
            has_linkset=True,
        )

    def property(self, robot: Robot, owner: str, item: Property) -> Resource:
        """Return a property of the thing at the path ``owner``."""
        path = f"{owner.rstrip('/')}/{item.segment}"
        # A new description is no change of a value unless its model differs, which holds the constants.
        source = Source(
            lambda: (robot.presence_facts, robot.model, item.facts(), robot.settings),
            item.sample,
            robot,
            counter=item.counter,
        )

        def measured(graph: Graph, measurements: Sequence[Measurement]) -> None:
            self.describer.property(robot, owner, item, graph, measurements[0])

        def constant(graph: Graph) -> None:
            self.describer.property(robot, owner, item, graph, Measurement())

        resource = Resource(
            path,
            item.title,
            MeasuredDescription(measured, (item.sample,))
            if item.is_measured
            else InSteps(lambda graph: self.describer.property_in_steps(robot, owner, item, graph))
            if item.is_long()
            else constant,
            source=source,
            own_paths=(path + "/blueprint", *related_layouts(path, item), *self._branches.property_paths(path, item)),
            documents=frame_writers(robot, item),
            layout_path=layout_path(path) if has_frames(item) else None,
            affords=put_affordance(item.put),
        )
        if item.json is not None:
            return resource.replace(documents={**resource.documents, JSON: item.json})
        return add_plain_json(resource, item.shape, self._view.base)

    def property_blueprint(self, robot: Robot, owner: str, item: Property) -> Resource:
        """Return the blueprint of a property."""
        whole = blueprint_at(
            f"{owner.rstrip('/')}/{item.segment}",
            self._view.base,
            (item.shape, *item.inputs),
            description_source(robot),
        )
        if (own := item.describe_shapes) is None:
            return target_blueprint(whole, item.put, self._view.base) if isinstance(item.put, Offer) else whole

        def describe(graph: Graph) -> None:
            run_steps(whole.own_steps(graph))
            own(graph)

        return whole.replace(describe=describe)

    def lease(self, robot: Robot) -> Resource:
        """Return the control lease of the robot."""
        path = lease_path(robot.name)
        return Resource(
            path,
            f"Control of {robot.name}",
            lambda graph: describe_lease(graph, self._view.base, robot),
            source=Source(lambda: robot.lease, robot=robot),
            own_paths=(path + "/blueprint",),
            affords=Control(robot),
        )

    def owned_resource(self, thing: Resource, rest: list[str], shapes: tuple[NamedNode, ...]) -> Resource | None:
        """Return the resource at the segments ``rest`` below a thing: its subscriptions, blueprint or link set."""
        path = f"{thing.path.rstrip('/')}/{rest[0]}"
        if rest[0] == "subscriptions":
            return resolve_subscription(thing, rest[1:], self._subscriptions.get(thing.path, ()), self._view.base)
        if rest == ["blueprint"]:
            return blueprint_of(thing, self._view.base, shapes, description_source(thing.source.robot))
        if rest == ["linkset"]:
            return Resource(path, f"Links of {thing.title}", None, (LDP.Resource,), linkset_of=thing)
        return None


def _battery_percent(robot: Robot) -> Decimal | None:
    """Return the lowest charge of its batteries, rounded down to per cent; without one, that of its annotations."""
    charges = [each.battery_percent for each in parts_of(robot).values()]
    known = [charge for charge in charges if charge is not None]
    return Decimal(int(min(known))) if known else battery_charge(robot)


def _thing(robot: Robot, properties: Sequence[Property], also: Callable[[], object] = tuple) -> Source:
    """Return the source of a thing, which changes with its properties' values and with its robot's description."""
    samplers = _samplers(properties)
    sampler = (lambda: tuple(chain.from_iterable(sampler() for sampler in samplers))) if samplers else tuple
    facts = [each.facts for each in properties if each.facts is not tuple]
    return Source(
        lambda: (robot.presence_facts, robot.description, robot.settings, also(), [fact() for fact in facts]),
        sampler,
        robot,
    )


def _samplers(properties: Sequence[Property]) -> tuple[Sampler, ...]:
    return tuple([each.sample for each in properties if each.is_measured])


def description_source(robot: Robot | None) -> Source:
    """Return the source of a resource that depends on the description of a robot only; None for no robot."""
    if robot is None:
        return Source()
    return Source(lambda: (robot.description, robot.annotations, robot.kept_poses), robot=robot)


def _own(path: str, properties: Sequence[Property], actions: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return sub-resources in the order of the Link field: subscriptions, blueprint, actions, properties."""
    stem = path.rstrip("/")
    return (stem + "/subscriptions", stem + "/blueprint", *actions, *(f"{stem}/{each.segment}" for each in properties))
