"""Descriptions of fleet, robot, joint, link and property as triples (paper figures 2b and 3, R1.3 to R1.12)."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from functools import lru_cache

from pyoxigraph import Literal, NamedNode

from linked_fleet_base.faults import Faults
from linked_fleet_gateway.resources.action_offer import Offer, fleet_offers, joint_offers, robot_offers
from linked_fleet_gateway.resources.annotations import annotate, pose_finding
from linked_fleet_gateway.resources.invocation import describe_unchecked, unchecked_links
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.part import RobotPart, parts_of
from linked_fleet_gateway.resources.paths import joint_path, lease_path, link_path, robot_path
from linked_fleet_gateway.resources.properties import joint_properties, link_properties, robot_properties
from linked_fleet_gateway.resources.property import Measurement, Property, added_link_statements
from linked_fleet_rdf.graph import UNITLESS, Graph, moment, timestamp
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, LF, PROV, RDFS, ROS, SOSA, XHV, XSD
from linked_fleet_state.model import Joint, Link, RobotModel
from linked_fleet_state.observation import Observation
from linked_fleet_state.robot import Robot

_SECOND_NS = 1_000_000_000
_MOST_FINDINGS = 32
Links = Iterable[tuple[NamedNode, str]]


@dataclass(frozen=True)
class Task:
    """A running invocation: its path, who has asked for it, and how far it is, in tenths."""

    path: str
    client: str = ""
    tenths: int = 0


@dataclass(frozen=True)
class RobotActivity:
    """The activity of a robot: its running invocations, the charge of its battery, and True while it moves.

    ``moved_ns``: the end of its last movement (wall time); None while it moves. ``holder`` has control of it; ``more``
    is what extensions add. ``link``: the term for how well its frames arrive.
    """

    tasks: tuple[Task, ...] = ()
    moved_ns: int | None = None
    battery_percent: Decimal | None = None
    moving: bool = False
    holder: str = ""
    more: tuple[tuple[NamedNode, Literal], ...] = ()
    link: str | None = field(default=None, repr=False)  # gateways differ in it, so it is no part of shared versions


class Describer:
    """Describes things under one base URL (scheme and authority, no trailing slash)."""

    def __init__(self, base: str) -> None:
        self.base = base

    def iri(self, path: str) -> NamedNode:
        return NamedNode(self.base + path)

    # -- the things -------------------------------------------------------------------------------------------------

    def fleet(
        self,
        members: Mapping[str, Robot],
        links: Links,
        graph: Graph,
        activities: Callable[[Robot], RobotActivity] = lambda robot: RobotActivity(),
        faults: Faults | None = None,
    ) -> Iterator[None]:
        """Describe the fleet, one robot in each step; ``links`` are predicate and path of its further resources.

        A robot that cannot be described has the reason as its fault.
        """
        faults = faults or Faults()
        root = self.iri("/")
        graph.a(root, HYBRIT.RoboticThing, LF.Fleet, LDP.BasicContainer, LDP.Container)
        graph.add(root, DCTERMS.title, Literal("Linked Fleet"))
        self._interface(graph, "/", LF.FleetShape)
        self._actions(graph, root, fleet_offers())
        graph.add(root, LF.vocabulary, self.iri("/vocabulary"))
        for predicate, path in links:
            graph.add(root, predicate, self.iri(path))
        robots = [robot for _, robot in sorted(members.items())]
        graph.add(root, LDP.contains, *(self.iri(robot_path(robot.name)) for robot in robots))
        for robot in robots:
            yield
            with faults.guard("the fleet", robot.name):
                self._introduce(graph, robot, activities)
            if not robot.fault and (reason := faults.find("the fleet", robot.name)):
                graph.add(self.iri(robot_path(robot.name)), LF.fault, Literal(reason))
        graph.add(root, LF.fault, *map(Literal, faults.of_parts))

    def _introduce(self, graph: Graph, robot: Robot, activities: Callable[[Robot], RobotActivity]) -> None:
        """Describe a robot as its fleet lists it."""
        iri = self.iri(robot_path(robot.name))
        graph.a(iri, HYBRIT.RoboticThing, LF.Robot)
        graph.add(iri, DCTERMS.title, Literal(robot.title))
        self.presence(graph, iri, robot)
        self._model_name(graph, iri, robot)
        does = activities(robot)
        for task in does.tasks:
            self._task(graph, iri, task)
        if does.holder:
            graph.add(iri, LF.lease, self.iri(lease_path(robot.name)))
            graph.add(self.iri(lease_path(robot.name)), LF.holder, Literal(does.holder))
        for predicate, value in does.more:
            graph.add(iri, predicate, value)
        if does.moving:
            graph.add(iri, LF.moving, Literal("true", datatype=XSD.boolean))
        if does.moved_ns is not None:
            graph.add(iri, LF.lastMoved, timestamp(does.moved_ns, resolution_ns=_SECOND_NS))
        if does.link is not None:
            graph.add(iri, LF.linkQuality, NamedNode(LF.iri + does.link))
        if does.battery_percent is not None:
            graph.add(iri, LF.batteryCharge, Literal(f"{does.battery_percent:.1f}", datatype=XSD.decimal))

    def _task(self, graph: Graph, robot: NamedNode, task: Task) -> None:
        """Describe what a robot is doing, for whom, and how far it is."""
        iri = self.iri(task.path)
        graph.add(robot, LF.currentTask, iri)
        graph.scalar(iri, LF.progress, task.tenths / 10, UNITLESS)
        if task.client:
            client = graph.blank(PROV.Agent)
            graph.add(iri, PROV.wasAssociatedWith, client)
            graph.add(client, DCTERMS.title, Literal(task.client))

    def robot(
        self,
        robot: Robot,
        tasks: Sequence[str],
        links: Links,
        graph: Graph,
        measurements: Sequence[Measurement] | None = None,
    ) -> None:
        """``tasks``: paths of the invocations that are under way; ``links``: as of the fleet.

        ``measurements``: other values than the present ones, one for each measured property, and the last frame.
        """
        path = robot_path(robot.name)
        iri = self.iri(path)
        graph.a(iri, HYBRIT.RoboticThing, LF.Robot)
        graph.add(iri, DCTERMS.title, Literal(robot.title))
        graph.add(iri, DCTERMS.identifier, Literal(robot.name))
        graph.add(iri, RDFS.seeAlso, self.iri("/"))
        self.presence(graph, iri, robot)
        self._last_frame(
            graph, iri, Measurement.from_observations(last_frame(robot)) if measurements is None else measurements[-1]
        )
        self._interface(graph, path, LF.RobotShape)
        self._actions(graph, iri, robot_offers(robot))
        graph.add(iri, LF.lease, self.iri(lease_path(robot.name)))
        graph.add(iri, LF.currentTask, *(self.iri(task) for task in tasks))
        for predicate, other in links:
            graph.add(iri, predicate, self.iri(other))
        self._annotations(graph, iri, robot)
        if robot.model is None or robot.description is None:
            return
        self._kept_poses(graph, iri, robot)
        describe_unchecked(graph, iri, self.base, unchecked_links(robot))
        self._model_name(graph, iri, robot)
        graph.add(iri, LF.finding, *map(Literal, (*_all_findings(robot.model), *robot.findings)))
        graph.add(iri, LF.baseMobility, Literal(robot.description.base))
        graph.add(iri, LF.rootLink, self.iri(link_path(robot.name, robot.model, robot.model.root)))
        graph.add(iri, DCTERMS.hasPart, *(self.iri(part) for part in part_paths(robot)))
        self._properties(graph, path, self.robot_properties(robot), None if measurements is None else measurements[:-1])
        for joint in robot.model.joints.values():
            self._introduce_joint(graph, robot, joint)
        for link in robot.model.links.values():
            self._introduce_link(graph, robot, link.name)
        for part in parts_of(robot).values():
            self._introduce_part(graph, part)

    def joint(
        self, robot: Robot, joint: Joint, graph: Graph, measurements: Sequence[Measurement] | None = None
    ) -> None:
        """Describe a joint; ``measurements`` replaces its present values, one for each measured property."""
        assert robot.model is not None
        path, kind = joint_path(robot.name, joint.name), kind_of(joint)
        iri = self.iri(path)
        self._introduce_joint(graph, robot, joint)
        self._interface(graph, path, kind.shape)
        graph.add(iri, LF.finding, *map(Literal, robot.model.findings_about("joint", joint.name)))
        if (fault := robot.sensor_faults.get(joint.name)) is not None:
            graph.add(iri, LF.fault, Literal(fault))
        self._actions(graph, iri, joint_offers(robot, joint))
        graph.add(iri, RDFS.seeAlso, self.iri(robot_path(robot.name)))
        graph.add(iri, DCTERMS.isPartOf, self.iri(robot_path(robot.name)))
        self._presence_if_not_online(graph, iri, robot)
        for predicates, link in (
            ((XHV.prev, ROS.preceedingLink), joint.parent),
            ((XHV.next, ROS.succeedingLink), joint.child),
        ):
            target = self.iri(link_path(robot.name, robot.model, link))
            for predicate in predicates:
                graph.add(iri, predicate, target)
        self._annotations(graph, iri, robot)
        self._properties(graph, path, joint_properties(robot, joint), measurements)
        self._introduce_link(graph, robot, joint.parent)
        self._introduce_link(graph, robot, joint.child)

    def link(self, robot: Robot, link: Link, graph: Graph, measurements: Sequence[Measurement] | None = None) -> None:
        """Describe a link; ``measurements`` as for joints."""
        assert robot.model is not None
        path = link_path(robot.name, robot.model, link.name)
        iri = self.iri(path)
        self._introduce_link(graph, robot, link.name)
        self._interface(graph, path, LF.LinkShape)
        graph.add(iri, LF.finding, *map(Literal, robot.model.findings_about("link", link.name)))
        graph.add(iri, RDFS.seeAlso, self.iri(robot_path(robot.name)))
        graph.add(iri, DCTERMS.isPartOf, self.iri(robot_path(robot.name)))
        self._presence_if_not_online(graph, iri, robot)
        parents = (link.parent_joint,) if link.parent_joint is not None else ()
        for predicates, names in (
            ((XHV.prev, LF.parentJoint), parents),
            ((XHV.next, LF.childJoint), link.child_joints),
        ):
            for name in names:
                for predicate in predicates:
                    graph.add(iri, predicate, self.iri(joint_path(robot.name, name)))
        for state in added_link_statements():
            for predicate, other in state(robot, link):
                graph.add(iri, predicate, self.iri(other))
        self._annotations(graph, iri, robot)
        self._properties(graph, path, link_properties(robot, link), measurements)
        for name in (*parents, *link.child_joints):
            self._introduce_joint(graph, robot, robot.model.joints[name])

    def part(
        self,
        part: RobotPart,
        items: Sequence[Property],
        graph: Graph,
        measurements: Sequence[Measurement] | None = None,
    ) -> None:
        """Describe another part with its properties; ``measurements`` as for joints."""
        iri, robot = self.iri(part.path), part.robot
        self._introduce_part(graph, part)
        graph.add(iri, HYBRIT.blueprint, *part.shapes)
        graph.add(iri, HYBRIT.blueprint, NamedNode(iri.value + "/blueprint"))
        graph.add(iri, HYBRIT.subscriptions, NamedNode(iri.value + "/subscriptions"))
        self._actions(graph, iri, part.offers.values())
        graph.add(iri, RDFS.seeAlso, self.iri(robot_path(robot.name)))
        graph.add(iri, DCTERMS.isPartOf, self.iri(robot_path(robot.name)))
        self._presence_if_not_online(graph, iri, robot)
        self._annotations(graph, iri, robot)
        part.describe(graph, iri, self.base)
        self._properties(graph, part.path, items, measurements)

    def part_in_steps(self, part: RobotPart, items: Sequence[Property], graph: Graph) -> Iterator[None]:
        """Describe a part, the values of which take long."""
        long = [each for each in items if each.is_long()]
        self.part(part, [each for each in items if each not in long], graph)
        thing = self.iri(part.path)
        for item in long:
            iri = self.iri(f"{part.path}/{item.segment}")
            graph.add(thing, HYBRIT.property, iri)
            graph.add(thing, item.predicate, iri)
            yield from self._property_in_steps(graph, iri, thing, item)

    def property_in_steps(self, robot: Robot, owner: str, item: Property, graph: Graph) -> Iterator[None]:
        """Describe a property, the value of which takes long."""
        iri = self.iri(f"{owner.rstrip('/')}/{item.segment}")
        yield from self._property_in_steps(graph, iri, self.iri(owner), item)
        self._presence_if_not_online(graph, iri, robot)

    def property(self, robot: Robot, owner: str, item: Property, graph: Graph, measurement: Measurement) -> None:
        """Describe a property as a small document of its own (Figure 3)."""
        iri = self.iri(f"{owner.rstrip('/')}/{item.segment}")
        self._property(graph, iri, self.iri(owner), item, measurement)
        self._presence_if_not_online(graph, iri, robot)

    # -- the pieces -------------------------------------------------------------------------------------------------

    def robot_properties(self, robot: Robot) -> list[Property]:
        return robot_properties(robot, self.iri)

    def presence(self, graph: Graph, iri: NamedNode, robot: Robot) -> None:
        graph.add(iri, LF.presence, {"online": LF.online, "offline": LF.offline, "faulty": LF.faulty}[robot.presence])
        if not robot.online:
            seen = robot.last_seen_ns
            graph.add(iri, LF.lastSeen, LF.unknown if seen is None else timestamp(seen))
        if robot.fault is not None:
            graph.add(iri, LF.fault, Literal(robot.fault))

    def _model_name(self, graph: Graph, iri: NamedNode, robot: Robot) -> None:
        if robot.model is not None and robot.model.name:
            graph.add(iri, LF.modelName, Literal(robot.model.name))

    def _presence_if_not_online(self, graph: Graph, iri: NamedNode, robot: Robot) -> None:
        if robot.presence != "online":
            self.presence(graph, iri, robot)

    def _kept_poses(self, graph: Graph, iri: NamedNode, robot: Robot) -> None:
        for title, pose in robot.kept_poses.items():
            node = self.iri(pose.path)
            graph.add(iri, LF.namedPose, node)
            graph.add(node, DCTERMS.title, Literal(title))
            if finding := pose_finding(robot, pose.positions):
                graph.add(node, LF.finding, Literal(finding))

    def _last_frame(self, graph: Graph, iri: NamedNode, seen: Measurement) -> None:
        graph.add(iri, LF.lastFrame, moment(seen.wall_ns))

    def _interface(self, graph: Graph, path: str, shape: NamedNode) -> None:
        iri, stem = self.iri(path), path.rstrip("/")
        graph.add(iri, HYBRIT.blueprint, shape, self.iri(stem + "/blueprint"))
        graph.add(iri, HYBRIT.subscriptions, self.iri(stem + "/subscriptions"))

    def _actions(self, graph: Graph, iri: NamedNode, offers: Iterable[Offer]) -> None:
        graph.add(iri, HYBRIT.action, *(self.iri(offer.path) for offer in offers))

    def _properties(
        self, graph: Graph, owner: str, items: Sequence[Property], measurements: Sequence[Measurement] | None = None
    ) -> None:
        measured = None if measurements is None else iter(measurements)
        thing, stem = self.iri(owner), owner.rstrip("/")
        iris = [self.iri(f"{stem}/{item.segment}") for item in items]
        graph.add(thing, HYBRIT.property, *iris)
        for iri, item in zip(iris, items, strict=True):
            graph.add(thing, item.predicate, iri)
        for iri, item in zip(iris, items, strict=True):
            shown = (
                next(measured)
                if item.is_measured and measured is not None
                else Measurement.from_observations(item.sample())
            )
            self._property(graph, iri, thing, item, shown)

    def _property(self, graph: Graph, iri: NamedNode, owner: NamedNode, item: Property, seen: Measurement) -> None:
        self._introduce_property(graph, iri, owner, item)
        item.describe(graph, iri, seen)

    def _property_in_steps(self, graph: Graph, iri: NamedNode, owner: NamedNode, item: Property) -> Iterator[None]:
        assert item.steps is not None
        self._introduce_property(graph, iri, owner, item)
        yield from item.steps(graph, iri)

    def _introduce_property(self, graph: Graph, iri: NamedNode, owner: NamedNode, item: Property) -> None:
        graph.a(iri, *item.types, HYBRIT.Property, *((SOSA.ObservableProperty,) if item.is_measured else ()))
        graph.add(iri, DCTERMS.title, Literal(item.title))
        graph.add(iri, RDFS.seeAlso, owner)
        graph.add(iri, HYBRIT.blueprint, item.shape, NamedNode(iri.value + "/blueprint"))
        graph.add(iri, HYBRIT.consumes, *item.inputs)

    def _introduce_joint(self, graph: Graph, robot: Robot, joint: Joint) -> None:
        iri = self.iri(joint_path(robot.name, joint.name))
        graph.a(iri, HYBRIT.RoboticThing, kind_of(joint).type, LF.Joint)
        graph.add(iri, DCTERMS.title, Literal(joint.name))

    def _introduce_link(self, graph: Graph, robot: Robot, link: str) -> None:
        assert robot.model is not None
        iri = self.iri(link_path(robot.name, robot.model, link))
        graph.a(iri, HYBRIT.RoboticThing, ROS.Link)
        graph.add(iri, DCTERMS.title, Literal(link))

    def _introduce_part(self, graph: Graph, part: RobotPart) -> None:
        iri = self.iri(part.path)
        graph.a(iri, HYBRIT.RoboticThing, *part.types)
        graph.add(iri, DCTERMS.title, Literal(part.title))
        graph.add(iri, DCTERMS.identifier, Literal(part.name))

    def _annotations(self, graph: Graph, iri: NamedNode, robot: Robot) -> None:
        annotate(graph, iri, robot.annotations, self.base + robot_path(robot.name))


def _all_findings(model: RobotModel) -> list[str]:
    """Return the findings of a robot and its parts; beyond ``_MOST_FINDINGS`` their number."""
    found = [each.sentence for each in model.findings]
    rest = len(found) - _MOST_FINDINGS
    return found if rest <= 0 else [*found[:_MOST_FINDINGS], f"{rest} more findings are shown at joints and links."]


def last_frame(robot: Robot) -> tuple[Observation, ...]:
    """Return the time of the present frame, without values.

    It is rounded to seconds: a time that changes with each frame would make every entity tag worthless.
    """
    frame = robot.frame
    return (_moment(None if frame is None else frame.wall_ns // _SECOND_NS),)


@lru_cache(maxsize=64)
def _moment(second: int | None) -> Observation:
    """Return the same object for the same second, so that the observation counts as unchanged."""
    return Observation((), None if second is None else second * _SECOND_NS)


def part_paths(robot: Robot) -> list[str]:
    """Return the paths of all joints and links, in URDF order, and of its other parts."""
    if robot.model is None:
        return []
    joints = [joint_path(robot.name, name) for name in robot.model.joints]
    links = [link_path(robot.name, robot.model, name) for name in robot.model.links]
    return [*joints, *links, *(part.path for part in parts_of(robot).values())]
