"""The resource ``/timeline``, and how it is read."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from linked_fleet_gateway.api import (
    FleetBranch,
    Found,
    Graph,
    InSteps,
    NotFound,
    Request,
    RequestView,
    Resource,
    Response,
    blueprint_of,
    read_resource,
)
from linked_fleet_gateway.extensions.timeline.collecting import Chronicle, Collector
from linked_fleet_gateway.extensions.timeline.describing import PATH, steps, timeline_csv, timeline_json
from linked_fleet_gateway.extensions.timeline.terms import LF
from linked_fleet_gateway.extensions.timeline.window import Window, parse_window
from linked_fleet_gateway.serving import Rendition, check_preconditions

CSV, JSON = "text/csv", "application/json"
_OWN = (PATH + "/blueprint",)


@dataclass(frozen=True)
class Timeline:
    """The timeline as a caller sees it; the query of the request selects a window."""

    collector: Collector
    view: RequestView


def timeline_branch(collector: Collector) -> FleetBranch:
    """Return the branch of the timeline."""

    def resolve(view: RequestView, rest: list[str]) -> Found:
        found = Resource(PATH, "Timeline", None, own_paths=_OWN, remote=Timeline(collector, view))
        if rest == ["blueprint"]:
            return blueprint_of(found, view.base, (LF.TimelineShape,))
        return None if rest else found

    return FleetBranch(PATH[1:], LF.timeline, resolve)


async def read_timeline(request: Request, resource: Resource, timeline: Timeline) -> Response:
    """Return the requested part of the timeline, written in a thread. Raises BadRequest, NotFound, Busy."""
    now_ns, view = time.time_ns(), timeline.view
    window = parse_window(request.query_params.multi_items(), now_ns)
    _check_robot(window, view)
    found, robots = await timeline.collector.collect(view, window, now_ns), tuple(view.robots)
    selected = _selected(found, view.base, robots)

    def write() -> Response:
        check_preconditions(request, selected)
        return read_resource(request, selected)

    return await request.services.writing_offload.run(write, len(found.activities) + 1, 0)


def _check_robot(window: Window, view: RequestView) -> None:
    if window.robot and window.robot not in view.robots:
        raise NotFound(f"There is no robot {window.robot!r}; robot is the name of one that you may read.")


def _selected(found: Chronicle, base: str, robots: tuple[str, ...]) -> Resource:
    def describe(graph: Graph) -> Iterator[None]:
        return steps(graph, base, found, robots)

    documents = {
        JSON: Rendition(partial(timeline_json, base, found, robots)),
        CSV: Rendition(partial(timeline_csv, base, found), "timeline.csv"),
    }
    return Resource(PATH, "Timeline", InSteps(describe), own_paths=_OWN, documents=documents, publishes_changes=False)
