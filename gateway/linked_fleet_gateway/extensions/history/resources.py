"""Histories in the tree: ``/{robot}/history``, and one below each measured property."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from linked_fleet_agent.wire.messages import Description
from linked_fleet_gateway.extensions.history.describe import Page, describe_property, describe_robot, page_of
from linked_fleet_gateway.extensions.history.files import CSV, MCAP, recording, table
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.series import (
    Series,
    all_columns,
    of_base,
    of_joint,
    of_link,
    remembers,
    samples,
)
from linked_fleet_gateway.extensions.history.span import Span
from linked_fleet_gateway.extensions.history.terms import LF
from linked_fleet_gateway.extensions.history.track import Excerpt, Joints, Track, joints_of
from linked_fleet_gateway.fleet.geometry import SUFFIXES, drawable, file_name
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.serialise import WriteError
from linked_fleet_gateway.resources.branches import Found, PropertyBranch, RequestView, RobotBranch
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.paths import joint_path, link_path, mesh_path, part_of, robot_path
from linked_fleet_gateway.resources.property import Property
from linked_fleet_gateway.resources.resource import Resource, blueprint_of
from linked_fleet_gateway.resources.versioning import Source

SEGMENT = "history"
_FILE_BYTES = 8 * 2**20
"""Most bytes of frames in one file; a longer history needs several files."""


@dataclass(frozen=True)
class HistoryPage:
    """A history as selected by a query, ready to be rendered in a thread. Files have longer pages than documents."""

    resource: Resource
    document: Page
    file: Page


@dataclass(frozen=True)
class RecordedHistory:
    """A history, whose part is selected by the query of the request (``extensions/history/http.py``)."""

    history: History
    shown: Callable[[Span], HistoryPage]


def history_branches(history: History) -> tuple[RobotBranch, PropertyBranch]:
    """Return the branch of robots and that of measured properties."""

    def of_robot(view: RequestView, robot: Robot, rest: list[str]) -> Found:
        found = _of_robot(history, view, robot)
        if rest == ["blueprint"]:
            return blueprint_of(found, view.base, (LF.HistoryShape,))
        return None if rest else found

    def of_property(view: RequestView, robot: Robot, owner: str, item: Property, rest: list[str]) -> Found:
        found = _of_property(history, view, robot, owner, item)
        if rest == ["blueprint"]:
            return blueprint_of(found, view.base, (LF.HistoryShape,))
        return None if rest else found

    in_robot = RobotBranch(SEGMENT, LF.history, of_robot, lambda robot: robot.model is not None)
    return in_robot, PropertyBranch(SEGMENT, of_property, remembers)


def _of_robot(history: History, view: RequestView, robot: Robot) -> Resource:
    path, title = robot_path(robot.name) + SEGMENT, f"History of {robot.name}"
    own, source = (path + "/blueprint",), Source(robot=robot)

    def shown(span: Span) -> HistoryPage:
        track, description = history.track(robot), robot.description
        joints = _joints(track, robot)
        page, file = page_of(track, span, span.observations), page_of(track, span, _most(track, span))

        def describe(graph: Graph) -> None:
            parts = [(view.iri(each), view.iri(f"{each}/{SEGMENT}")) for each in measured(robot)]
            describe_robot(graph, view.base, view.iri(path), robot, history, page, parts)

        def csv() -> bytes:
            excerpt = _kept(file, joints)
            return table(all_columns(robot.name, excerpt.joints), samples(excerpt))

        def mcap() -> bytes:
            return recording(_kept(file, joints), _urdf(robot.name, description, view.base))

        documents = {CSV: csv, MCAP: mcap}
        resource = Resource(path, title, describe, source=source, own=own, documents=documents, followed=False)
        return HistoryPage(resource, page, file)

    return Resource(path, title, None, source=source, own=own, remote=RecordedHistory(history, shown))


def _of_property(history: History, view: RequestView, robot: Robot, owner: str, item: Property) -> Resource:
    of = f"{owner.rstrip('/')}/{item.segment}"
    path, title, source = f"{of}/{SEGMENT}", f"History of {item.title}", Source(robot=robot)
    whole = robot_path(robot.name) + SEGMENT
    own = (path + "/blueprint",)

    def shown(span: Span) -> HistoryPage:
        track = history.track(robot)
        joints = _joints(track, robot)
        page, file = page_of(track, span, span.observations), page_of(track, span, _most(track, span))
        series = None if joints is None else _series(joints, robot, owner, item)

        def describe(graph: Graph) -> None:
            iri, about, thing, robots = map(view.iri, (path, of, owner, whole))
            describe_property(graph, iri, about, thing, robots, item, series, page)

        def csv() -> bytes:
            if series is None:
                raise WriteError(f"{robot.name} has not said what it is")
            return table(series.columns, series.samples(_kept(file, joints)))

        resource = Resource(path, title, describe, source=source, own=own, documents={CSV: csv}, followed=False)
        return HistoryPage(resource, page, file)

    return Resource(path, title, None, source=source, own=own, remote=RecordedHistory(history, shown))


def _series(joints: Joints, robot: Robot, owner: str, item: Property) -> Series | None:
    if owner == robot_path(robot.name):
        return of_base(item)
    joint, link = part_of(owner.rpartition("/")[2], joints.model)
    if joint is not None:
        return of_joint(joints, joint, item)
    assert link is not None
    return of_link(joints, link)


def measured(robot: Robot) -> Iterator[str]:
    """Yield the paths of properties whose values frames contain."""
    model, description = robot.model, robot.description
    if model is None or description is None:
        return
    if description.base == "floating":
        yield from (f"{robot_path(robot.name)}{each}" for each in ("pose", "twist"))
    for joint in description.joints:
        path = joint_path(robot.name, joint)
        yield from (f"{path}/{each}" for each in (kind_of(model.joints[joint]).position, "velocity", "effort"))
    yield from (f"{link_path(robot.name, model, link)}/pose" for link in model.links)


def _joints(track: Track | None, robot: Robot) -> Joints | None:
    return joints_of(robot) if track is None else track.joints


def _most(track: Track | None, span: Span) -> int:
    """Return the number of samples that fit into one file."""
    newest = None if track is None else track.newest
    fit = 1 if newest is None else max(1, _FILE_BYTES // len(newest))
    return fit if span.limit is None else min(span.limit, fit)


def _kept(page: Page, joints: Joints | None) -> Excerpt:
    """Return the frames of a page; without any, an empty excerpt."""
    if page.excerpt is not None:
        return page.excerpt
    if joints is None:
        raise WriteError("the robot has not said what it is")
    return Excerpt(joints)


def _urdf(robot: str, description: Description | None, base: str) -> bytes:
    """Return the URDF with public URLs of its meshes."""
    if description is None:
        raise WriteError(f"{robot} has not said what it is")
    meshes = [each for each in description.meshes if each.type in SUFFIXES]
    return drawable(description.urdf, {each.uri: base + mesh_path(robot, file_name(each)) for each in meshes})
