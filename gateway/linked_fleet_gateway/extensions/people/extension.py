"""The extension ``people``: who is here, who has control of which robot, and requests for control."""

import logging
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

from linked_fleet_gateway.api import (
    Core,
    Extension,
    Mount,
    RequestView,
    Table,
    cancel_tasks,
    supervised,
)
from linked_fleet_gateway.extensions.people import asking
from linked_fleet_gateway.extensions.people.control_request import ControlRequest
from linked_fleet_gateway.extensions.people.operations import operations
from linked_fleet_gateway.extensions.people.presence import Presence
from linked_fleet_gateway.extensions.people.resources import PATH, SEGMENT, people_branch
from linked_fleet_gateway.extensions.sessions.service import Sessions

log = logging.getLogger(__name__)
HERE = Path(__file__).parent
LOOK_S = 1.0


class PeopleExtension(Extension):
    """People at ``/people``, requests for control at ``/control-requests``."""

    name = "people"
    at_root = (SEGMENT, asking.SEGMENT)
    uses = ("sessions",)
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    kinds = (HERE / "kinds.ttl",)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.people import page

        return (page.VIEW,)

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        sessions = core.optional_service(Sessions)

        def seen() -> Mapping[str, float]:
            return {} if sessions is None else sessions.seen_s

        holders: dict[str, str] = {}

        def changed() -> None:
            core.mark_changed(PATH)

        def hear(robot: str | None) -> None:
            nonlocal holders
            if robot is None:
                now = {name: each.lease.holder for name, each in core.robots.items() if each.lease is not None}
                if now != holders:
                    holders = now
                    changed()

        make = partial(asking.container_of, core)
        async with (
            Presence(core, seen, changed) as presence,
            core.open_container("control-requests", ControlRequest, make, asking.MOST) as requests,
        ):
            records = requests.records
            assert isinstance(records, Table)
            forget = partial(asking.forget_ended, records)
            tasks = [supervised(forget, "forget requests for control", log, "requests for control stay", LOOK_S)]
            try:
                with core.listening_to_requests(presence.hear), core.listening(hear):
                    yield Mount(
                        branches=(people_branch(presence), requests.branch), handlers=asking.handlers(core, records)
                    )
            finally:
                await cancel_tasks(tasks)
