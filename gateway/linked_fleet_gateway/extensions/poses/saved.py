"""The poses that gateways share, as one container for each robot."""

import asyncio
import time
from collections.abc import Iterator, Mapping
from functools import partial

from msgspec.structs import replace

from linked_fleet_gateway.api import (
    DCTERMS,
    RDFS,
    Conflict,
    Container,
    Core,
    Found,
    Graph,
    InSteps,
    KeptPose,
    Literal,
    Member,
    NamedNode,
    RedisUnavailable,
    RequestView,
    Resource,
    Right,
    Robot,
    RobotBranch,
    Table,
    UnprocessableContent,
    cancel_tasks,
    joint_path,
    robot_path,
    timestamp,
)
from linked_fleet_gateway.extensions.poses.pose import SavedPose, groups_of, read_pose
from linked_fleet_gateway.extensions.poses.terms import LF, MODIFIED
from linked_fleet_gateway.faces import Identity, Tree, commandable_joints, kind_of, named_poses, pose_finding
from linked_fleet_rdf.graph import RADIAN
from linked_fleet_rdf.vocabulary import VOM

SEGMENT = "poses"
MOST_OF_ROBOT = 100
RETRY_S = 1.0


class PosesOfRobot:
    """The poses of one robot, as the records of its container."""

    def __init__(self, table: Table[SavedPose] | None, robot: Robot, known: Mapping[str, SavedPose]) -> None:
        """``table`` is None for a container that only describes what any has in common."""
        self._table, self._robot, self.known = table, robot, known

    async def add(self, record: SavedPose) -> str:
        """Add a pose and return its id. Raises Conflict, RedisUnavailable, ContainerFull."""
        self._check_title(record, "")
        if len(self.known) >= MOST_OF_ROBOT:
            raise Conflict(f"{record.robot} has {MOST_OF_ROBOT} poses, which are the most. Delete one of them first.")
        assert self._table is not None
        return await self._table.add(record)

    async def change(self, id: str, record: SavedPose | None) -> bool:
        """Replace the known pose, or remove it for None. Return False if it has changed meanwhile."""
        if record is not None:
            self._check_title(record, id)
        assert self._table is not None
        return await self._table.change(id, record)

    def _check_title(self, record: SavedPose, id: str) -> None:
        """Raise Conflict for a title by which actions would take another pose."""
        other = next((each for each, pose in self.known.items() if each != id and pose.title == record.title), "")
        if other:
            path = f"{poses_path(record.robot)}/{other}"
            raise Conflict(
                f"There is a pose {record.title!r} of {record.robot} already, at {path}. Change that one, or"
                " give another title."
            )
        if record.title in named_poses(self._robot) and record.title not in self._robot.kept_poses:
            raise Conflict(f"{record.robot} itself names a pose {record.title!r}; give another title.")


def poses_path(robot: str) -> str:
    return robot_path(robot) + SEGMENT


class Poses:
    """The poses of all robots. Robots name those of theirs, so that their actions take them."""

    def __init__(self, core: Core, most: int) -> None:
        self._core = core
        self.table = core.table(SEGMENT, SavedPose, self._changed, most)
        self._of_robots: dict[str, dict[str, SavedPose]] = {}
        self._containers: dict[str, tuple[Robot, Container[SavedPose]]] = {}
        self._forgetting = set[asyncio.Task[None]]()

    @property
    def branch(self) -> RobotBranch:
        return RobotBranch(
            SEGMENT, LF.savedPoses, self._resolve, lambda robot: bool(self.of(robot.name) or commandable_joints(robot))
        )

    def of(self, robot: str) -> Mapping[str, SavedPose]:
        """Return the poses of a robot by id."""
        return self._of_robots.get(robot, {})

    async def close(self) -> None:
        await cancel_tasks(self._forgetting)

    # -- news -------------------------------------------------------------------------------------------------------

    def _changed(self, id: str, before: SavedPose | None, after: SavedPose | None) -> None:
        pose = after or before
        assert pose is not None
        of_robot = self._of_robots.setdefault(pose.robot, {})
        path = f"{poses_path(pose.robot)}/{id}"
        if after is None:
            of_robot.pop(id, None)
        else:
            of_robot[id] = after
        self._name(pose.robot)
        if before is None:
            self._core.live.fan_out.add_resource(path)
        self._core.mark_changed(path, poses_path(pose.robot))

    def described(self, robot: str) -> None:
        """Let a robot that has described itself name its poses: they may fit no longer."""
        self._name(robot)
        path = poses_path(robot)
        self._core.mark_changed(path, *(f"{path}/{id}" for id in self.of(robot)))

    def _name(self, robot: str) -> None:
        """Let a robot name its poses. Of two with one title, which gateways added at once, the one that sorts first."""
        named = dict[str, KeptPose]()
        for id, pose in sorted(self.of(robot).items()):
            named.setdefault(pose.title, KeptPose(f"{poses_path(robot)}/{id}", pose.positions))
        self._core.set_poses(robot, dict(sorted(named.items())))

    def removed(self, robot: str) -> None:
        """Delete the poses of a robot that was removed."""
        self._containers.pop(robot, None)
        for id in self.of(robot):
            task = asyncio.create_task(self._forget(id), name=f"delete the pose {id}")
            self._forgetting.add(task)
            task.add_done_callback(self._forgetting.discard)

    async def _forget(self, id: str) -> None:
        while id in self.table.known:
            try:
                if await self.table.change(id, None):
                    return
            except RedisUnavailable:
                await asyncio.sleep(RETRY_S)

    # -- resources --------------------------------------------------------------------------------------------------

    def _resolve(self, view: RequestView, robot: Robot, rest: list[str]) -> Found:
        found = self.container(robot).branch.resolve(view, rest)
        if rest or not isinstance(found, Resource):
            return found
        iri, describe, facts = view.iri(found.path), found.describe, found.source.facts
        assert describe is not None

        def steps(graph: Graph) -> Iterator[None]:
            if isinstance(describe, InSteps):
                yield from describe.steps(graph)
            else:
                describe(graph)
            _describe_groups(graph, iri, robot, view)

        source = replace(found.source, facts=lambda: (facts(), groups_of(robot)))
        in_steps = InSteps(steps)
        return found.replace(describe=in_steps if isinstance(describe, InSteps) else in_steps.__call__, source=source)

    def container(self, robot: Robot) -> Container[SavedPose]:
        """Return the container of the poses of a robot."""
        held = self._containers.get(robot.name)
        if held is None or held[0] is not robot:
            held = self._containers[robot.name] = robot, self._container(robot)
        return held[1]

    def _container(self, robot: Robot) -> Container[SavedPose]:
        known = self._of_robots.setdefault(robot.name, {})
        return container_of(robot, PosesOfRobot(self.table, robot, known))


def container_of(robot: Robot, records: PosesOfRobot) -> Container[SavedPose]:
    return Container(
        segment=poses_path(robot.name)[1:], title=f"Poses of {robot.name}", type=LF.PoseList,
        member_type=LF.SavedPose, records=records, shape=LF.PoseInput, read=partial(read_pose, robot),
        describe=_describe, title_of=lambda pose: pose.title, blueprint=LF.PoseListShape,
        member_blueprint=LF.SavedPoseShape, writing=(Right.ACT, Right.ADMIN), check=_check,
        signed=_signed, facts=_findings,
    )  # fmt: skip


async def _check(pose: SavedPose, tree: Tree, caller: Identity) -> None:
    """Raise UnprocessableContent for joints of another gateway."""
    if pose.base not in (None, tree.view.base):
        raise UnprocessableContent(f"The joints of a pose are below {tree.view.base}{robot_path(pose.robot)}.")


def _signed(pose: SavedPose, caller: Identity, client: str) -> SavedPose:
    return replace(pose, base=None, by=caller.name or client, saved_ns=time.time_ns())


def _describe(graph: Graph, member: Member[SavedPose]) -> None:
    iri, pose, view = member.iri, member.record, member.view
    graph.a(iri, LF.NamedPose)
    graph.add(iri, LF.ofRobot, view.iri(robot_path(pose.robot)))
    if pose.note:
        graph.add(iri, RDFS.comment, Literal(pose.note))
    graph.add(iri, LF.savedBy, Literal(pose.by))
    graph.add(iri, MODIFIED, timestamp(pose.saved_ns))
    graph.add(iri, LF.finding, *map(Literal, _findings(member)))
    robot = view.robots.get(pose.robot)
    model = None if robot is None else robot.model
    for name, position in pose.positions.items():
        joint = None if model is None else model.joints.get(name)
        dimension = None if joint is None else kind_of(joint).dimension
        target = graph.blank()
        graph.add(iri, LF.target, target)
        graph.add(target, LF.ofJoint, view.iri(joint_path(pose.robot, name)))
        graph.add(target, VOM.numericalValue, Literal(position))
        graph.add(target, VOM.unit, (RADIAN if dimension is None else dimension.position).qudt)


def _findings(member: Member[SavedPose]) -> tuple[str, ...]:
    """Return why actions of the robot do not take a pose; nothing if they do."""
    pose, robot = member.record, member.view.robots.get(member.record.robot)
    if robot is None or robot.model is None:
        return ()
    if finding := pose_finding(robot, pose.positions):
        return (finding,)
    taken = named_poses(robot).get(pose.title)
    if taken is None or dict(taken) == pose.positions:
        return ()
    return (f"{pose.robot} has another pose {pose.title!r}, which its actions take. Give one of them another title.",)


def _describe_groups(graph: Graph, iri: NamedNode, robot: Robot, view: RequestView) -> None:
    graph.add(iri, RDFS.seeAlso, view.iri(robot_path(robot.name)))
    graph.add(iri, LF.ofRobot, view.iri(robot_path(robot.name)))
    for name, joints in groups_of(robot).items():
        node = graph.blank(LF.JointGroup)
        graph.add(iri, LF.jointGroup, node)
        graph.add(node, DCTERMS.title, Literal(name))
        graph.add(node, LF.ofJoint, *(view.iri(joint_path(robot.name, each)) for each in joints))
