"""Parts of histories that memory has no longer: read from disk, and joined with what memory has.

Frames on disk are sparser (thinning.py). They are those before the oldest frame in memory, so that no time comes twice.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from linked_fleet_agent.urdf.document import UrdfError
from linked_fleet_gateway.extensions.history.archive import Archive
from linked_fleet_gateway.extensions.history.describe import Page
from linked_fleet_gateway.extensions.history.segment import Layout
from linked_fleet_gateway.extensions.history.shelf import MOST_BYTES, Found
from linked_fleet_gateway.extensions.history.span import Span
from linked_fleet_gateway.extensions.history.track import Excerpt, Joints, wall_ns
from linked_fleet_state.model import RobotModel


def with_extent(archive: Archive | None, robot: str, page: Page) -> Page:
    """Return the page with the times of the whole history, on disk too."""
    on_disk = None if archive is None else archive.shelf.extent(robot)
    if on_disk is None:
        return page
    low, high = page.time_range or on_disk
    return replace(page, time_range=(min(low, on_disk[0]), max(high, on_disk[1])))


def beyond(archive: Archive | None, robot: str, page: Page, most: int) -> Callable[[], Page] | None:
    """Return what reads the page in a thread, if memory has not all of it; ``page`` is what memory has.

    It has at most ``most`` frames and MOST_BYTES, since frames on disk may be longer than the present ones. Without a
    time, a history is that in memory.
    """
    span = page.span
    if archive is None or span == Span(limit=span.limit):
        return None
    memory, excerpt = page.time_range, page.excerpt
    if span.at_ns is not None:
        if memory is not None and span.at_ns >= memory[0] and excerpt is not None and excerpt.frames:
            return None
        at_ns = span.at_ns
        return lambda: _at(archive, robot, page, at_ns)
    if span.forward:
        newest_ns = _newest(archive, robot, memory)
        begin_ns = None if newest_ns is None else span.begin(newest_ns)
        if begin_ns is None or (memory is not None and begin_ns >= memory[0]):
            return None
        return lambda: _forward(archive, robot, page, begin_ns, most)
    if excerpt is not None and (len(excerpt.frames) >= most or excerpt.before is not None):
        return None
    return lambda: _backward(archive, robot, page, most)


def _newest(archive: Archive, robot: str, memory: tuple[int, int] | None) -> int | None:
    if memory is not None:
        return memory[1]
    on_disk = archive.shelf.extent(robot)
    return None if on_disk is None else on_disk[1]


def _at(archive: Archive, robot: str, page: Page, at_ns: int) -> Page:
    found = archive.shelf.at(robot, at_ns)
    joints = _joints_of(found.layout)
    return page if joints is None else _page(page, found, Excerpt(joints, found.frames))


def _forward(archive: Archive, robot: str, page: Page, begin_ns: int, most: int) -> Page:
    """Return the first frames from a time on: those on disk, and as many in memory as there is room for."""
    found = archive.shelf.read(robot, begin_ns, _end_of_disk(page), most, MOST_BYTES)
    joints = _joints_of(found.layout)
    if joints is None:
        return page
    later, memory = tuple[bytes, ...](), page.excerpt
    after = found.after
    if memory is not None and after is None:
        fit = _fitting(memory.frames, MOST_BYTES - _bytes(found.frames))
        room = min(most - len(found.frames), fit) if joints.has_same_layout(memory.joints) else 0
        later = memory.frames[:room]
        after = wall_ns(memory.frames[room]) if room < len(memory.frames) else memory.after
    return _page(page, found, Excerpt(joints, (*found.frames, *later), None, after))


def _backward(archive: Archive, robot: str, page: Page, most: int) -> Page:
    """Return the last frames before a time: those in memory, and before them as many on disk as there is room for."""
    memory = page.excerpt
    frames = () if memory is None else memory.frames
    found = archive.shelf.read(robot, None, _end_of_disk(page), most - len(frames), MOST_BYTES - _bytes(frames))
    joints = _joints_of(found.layout)
    if joints is None:
        return page
    if memory is not None and frames and not joints.has_same_layout(memory.joints):
        return replace(page, excerpt=replace(memory, before=wall_ns(found.frames[-1])))
    return _page(page, found, Excerpt(joints, (*found.frames, *frames), found.before, None))


def _bytes(frames: Sequence[bytes]) -> int:
    return sum(map(len, frames))


def _fitting(frames: Sequence[bytes], most_bytes: int) -> int:
    """Return how many of the first frames, which have one length, have at most so many bytes."""
    return max(0, most_bytes) // len(frames[0]) if frames else 0


def _page(page: Page, found: Found, excerpt: Excerpt) -> Page:
    return replace(page, excerpt=excerpt, urdf="" if found.layout is None else found.layout.urdf)


def _end_of_disk(page: Page) -> int | None:
    """Return until when the page is read from disk."""
    ends = [each for each in (page.span.end_ns, page.time_range and page.time_range[0]) if each is not None]
    return min(ends, default=None)


def _joints_of(layout: Layout | None) -> Joints | None:
    """Return what the frames of a layout mean; None if its URDF is damaged."""
    if layout is None:
        return None
    try:
        model = RobotModel.for_urdf(layout.urdf)
    except UrdfError:
        return None
    known = all(name in model.joints for name in layout.joints)
    return Joints(model, layout.joints, layout.floating) if known else None
