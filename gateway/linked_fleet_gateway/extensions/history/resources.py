"""Histories in the tree: ``/{robot}/history``, and one below each measured property."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

from pyoxigraph import Literal

from linked_fleet_agent.wire.messages import Description
from linked_fleet_gateway.api import (
    Found,
    Property,
    PropertyBranch,
    RequestView,
    Resource,
    RobotBranch,
    Source,
    blueprint_of,
    joint_path,
    link_path,
    robot_path,
    thing_at,
)
from linked_fleet_gateway.extensions.history.beyond import beyond, with_extent
from linked_fleet_gateway.extensions.history.compiled import history_template, robot_history_template
from linked_fleet_gateway.extensions.history.describe import (
    LF,
    Page,
    describe_property,
    describe_robot,
    extent,
    page_of,
)
from linked_fleet_gateway.extensions.history.files import CSV, MCAP, recording, table
from linked_fleet_gateway.extensions.history.ground import ground_of
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.shelf import MOST_BYTES
from linked_fleet_gateway.extensions.history.span import Span
from linked_fleet_gateway.extensions.history.thinning import spaced
from linked_fleet_gateway.extensions.history.track import (
    Excerpt,
    Joints,
    Series,
    Track,
    all_columns,
    base_series,
    has_history,
    joint_series,
    joints_of,
    layout_size,
    link_series,
    samples,
    wall_ns,
)
from linked_fleet_gateway.extensions.history.values import VALUES, values_of
from linked_fleet_gateway.extensions.models.geometry import SUFFIXES, file_name, mesh_path, urdf_with_mesh_addresses
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.faces import DescriptionTemplate, kind_of
from linked_fleet_gateway.serving import Rendition
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import WriteError
from linked_fleet_state.model import Joint
from linked_fleet_state.robot import Robot

SEGMENT = "history"
_SPACED = 45_000
"""Samples from which those of a page with ``every`` are chosen: six hours of a robot that moves, on disk."""
_SHORT, _SHORT_OF_VECTORS = 256, 16
"""Samples of a page that are read at once; a pose is computed from the positions of all joints above."""


@dataclass(frozen=True)
class HistoryPage:
    """A history as selected by a query, ready to be rendered in a thread. Files have longer pages than documents."""

    resource: Resource
    document: Page
    file: Page
    template: Callable[[], DescriptionTemplate | None] = lambda: None
    """Returns the kind of the document, with its samples; in a thread unless it ``is_short``."""
    is_short: bool = False
    """True if its samples are read in a millisecond or two."""
    on_disk: Callable[[bool], "HistoryPage"] | None = None
    """Returns the page with what only the disk has, without what ``every`` leaves out, in a thread; True for that of a
    file."""


@dataclass(frozen=True)
class RecordedHistory:
    """A history, whose part is selected by the query of the request (``extensions/history/extension.py``)."""

    history: History
    select_page: Callable[[Span], HistoryPage]


def history_branches(history: History, world: World | None) -> tuple[RobotBranch, PropertyBranch]:
    """Return the branch of robots and that of measured properties."""

    def of_robot(view: RequestView, robot: Robot, rest: list[str]) -> Found:
        found = _of_robot(history, world, view, robot)
        if rest == ["blueprint"]:
            return blueprint_of(found, view.base, (LF.HistoryShape,))
        if rest[:1] == [VALUES] and history.archive is not None:
            return values_of(history, view, robot, rest[1:])
        return None if rest else found

    def of_property(view: RequestView, robot: Robot, owner: str, item: Property, rest: list[str]) -> Found:
        found = _of_property(history, view, robot, owner, item)
        if rest == ["blueprint"]:
            return blueprint_of(found, view.base, (LF.HistoryShape,))
        return None if rest else found

    in_robot = RobotBranch(SEGMENT, LF.history, of_robot, lambda robot: robot.model is not None)
    return in_robot, PropertyBranch(SEGMENT, of_property, has_history)


def _of_robot(history: History, world: World | None, view: RequestView, robot: Robot) -> Resource:
    path, title = robot_path(robot.name) + SEGMENT, f"History of {robot.name}"
    own, source = (path + "/blueprint", *((f"{path}/{VALUES}",) if history.archive else ())), Source(robot=robot)

    def shown(span: Span) -> HistoryPage:
        track, description = history.track(robot), robot.description
        joints, ground = _joints(track, robot), ground_of(world, robot)
        below = [each.removeprefix(robot_path(robot.name)) for each in measured_paths(robot)]

        def made(page: Page, file: Page) -> HistoryPage:
            page = with_extent(history.archive, robot.name, page)

            def describe(graph: Graph) -> None:
                about = Literal(title), extent(page)
                describe_robot(graph, view.base, robot_path(robot.name), robot, history, about, below)

            def csv() -> bytes:
                excerpt = _kept(file, joints)
                return table(all_columns(robot.name, excerpt.joints), samples(excerpt))

            def mcap() -> bytes:
                kept = _kept(file, joints)
                now = not file.urdf or kept.joints.model is robot.model
                urdf = _urdf(robot.name, description, view.base) if now else file.urdf.encode()
                return recording(kept, urdf, ground=ground)

            documents = {CSV: Rendition(csv, _file(path, "csv")), MCAP: Rendition(mcap, _file(path, "mcap"))}
            resource = Resource(
                path, title, describe, source=source, own_paths=own, documents=documents, publishes_changes=False
            )
            template = partial(robot_history_template, view.base, robot, history, page, below)
            return HistoryPage(resource, page, file, template, is_short=True)

        return _pages(history, robot, track, span, made)

    return Resource(path, title, None, source=source, own_paths=own, remote=RecordedHistory(history, shown))


def _of_property(history: History, view: RequestView, robot: Robot, owner: str, item: Property) -> Resource:
    of = f"{owner.rstrip('/')}/{item.segment}"
    path, title, source = f"{of}/{SEGMENT}", f"History of {item.title}", Source(robot=robot)
    whole = robot_path(robot.name) + SEGMENT
    own = (path + "/blueprint",)

    def shown(span: Span) -> HistoryPage:
        track = history.track(robot)
        present = _joints(track, robot)

        def made(page: Page, file: Page) -> HistoryPage:
            page = with_extent(history.archive, robot.name, page)
            joints = present if page.excerpt is None else page.excerpt.joints
            series = None if joints is None else _series(joints, robot, owner, item)

            def describe(graph: Graph) -> None:
                iri, about, thing, robots = map(view.iri, (path, of, owner, whole))
                describe_property(graph, iri, about, thing, robots, item, series, page)

            def csv() -> bytes:
                kept = _kept(file, present)
                known = _series(kept.joints, robot, owner, item)
                if known is None:
                    raise WriteError(f"{robot.name} had no such joint then")
                return table(known.columns, known.samples(kept))

            documents = {CSV: Rendition(csv, _file(path, "csv"))}
            resource = Resource(
                path, title, describe, source=source, own_paths=own, documents=documents, publishes_changes=False
            )
            template = partial(history_template, view.base, of, item, series, page)
            return HistoryPage(resource, page, file, template, _is_short(page, series))

        return _pages(history, robot, track, span, made)

    return Resource(path, title, None, source=source, own_paths=own, remote=RecordedHistory(history, shown))


def _pages(
    history: History, robot: Robot, track: Track | None, span: Span, made: Callable[[Page, Page], HistoryPage]
) -> HistoryPage:
    """Return what memory has of a span, and how the rest is read."""
    shortest, longest = span.observations, _most(history, track, robot, span)
    if span.every_ns is not None:  # most samples are left out
        shortest = max(shortest, _SPACED)
    page, file = page_of(track, span, shortest), page_of(track, span, longest)
    of_page, of_file = (
        beyond(history.archive, robot.name, each, most) for each, most in ((page, shortest), (file, longest))
    )
    found = made(page, file)
    if of_page is None and of_file is None and span.every_ns is None:
        return found

    def on_disk(is_file: bool) -> HistoryPage:
        if is_file:
            return made(page, _spaced_page(file if of_file is None else of_file(), span.limit))
        return made(_spaced_page(page if of_page is None else of_page(), span.observations), file)

    return replace(found, on_disk=on_disk)


def _spaced_page(page: Page, most: int | None) -> Page:
    """Return the page with at most so many of the samples that ``every`` leaves."""
    excerpt, every_ns = page.excerpt, page.span.every_ns
    if excerpt is None or every_ns is None:
        return page
    frames, before, after = spaced(excerpt.frames, every_ns, excerpt.after is None), excerpt.before, excerpt.after
    if after is not None and frames:
        after = max(after, wall_ns(frames[-1]) + every_ns)
    if most is not None and len(frames) > most:
        if page.span.forward:
            frames, after = frames[:most], wall_ns(frames[most])
        else:
            frames, before = frames[-most:], wall_ns(frames[-most - 1])
    return replace(page, excerpt=replace(excerpt, frames=frames, before=before, after=after))


def _file(path: str, suffix: str) -> str:
    return f"{path[1:].replace('/', '-')}.{suffix}"


def _is_short(page: Page, series: Series | None) -> bool:
    samples = 0 if page.excerpt is None else len(page.excerpt.frames)
    return samples <= (_SHORT if series is None or len(series.columns) == 1 else _SHORT_OF_VECTORS)


def _series(joints: Joints, robot: Robot, owner: str, item: Property) -> Series | None:
    if owner == robot_path(robot.name):
        return base_series(item)
    _, part = thing_at(owner, {robot.name: robot}) or (robot, None)
    if isinstance(part, Joint):
        return joint_series(joints, part.name, item)
    assert part is not None
    return link_series(joints, part.name)


def measured_paths(robot: Robot) -> Iterator[str]:
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


def _most(history: History, track: Track | None, robot: Robot, span: Span) -> int:
    """Return the number of samples that fit into one file."""
    newest, joints = None if track is None else track.newest, _joints(track, robot)
    if newest is not None:
        fit = max(1, MOST_BYTES // len(newest))
    elif joints is not None and history.archive is not None:
        fit = max(1, MOST_BYTES // layout_size(joints))
    else:
        fit = 1
    return fit if span.limit is None or span.every_ns is not None else min(span.limit, fit)


def _kept(page: Page, joints: Joints | None) -> Excerpt:
    """Return the frames of a page; without any, an empty excerpt."""
    if page.excerpt is not None:
        return page.excerpt
    if joints is None:
        raise WriteError("the robot has not published its description")
    return Excerpt(joints)


def _urdf(robot: str, description: Description | None, base: str) -> bytes:
    """Return the URDF with public URLs of its meshes."""
    if description is None:
        raise WriteError(f"{robot} has not published its description")
    meshes = [each for each in description.meshes if each.type in SUFFIXES]
    return urdf_with_mesh_addresses(
        description.urdf, {each.uri: base + mesh_path(robot, file_name(each)) for each in meshes}
    )
