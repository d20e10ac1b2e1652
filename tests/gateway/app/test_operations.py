"""Extensions declare the operations of their resources, and every description of the gateway includes them."""

from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from types import SimpleNamespace
from typing import Any, ClassVar, cast

from linked_fleet_base.faults import Faults
from linked_fleet_gateway.app.extensions import mount_extensions
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.json_form import Json


class _Gripper(Extension):
    name = "gripper"

    def operations(self, view: RequestView) -> Mapping[str, Json]:
        return {"/gripper": {}}


class _Describing(Extension):
    name = "describing"
    found: ClassVar[list[str]] = []

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        self.found[:] = [path for each in core.extensions for path in each.operations(cast(Any, None))]
        yield Mount()


async def test_descriptions_include_operations_of_extensions_started_later() -> None:
    live = SimpleNamespace(add_branches=lambda *_: None, faults=Faults())
    actions = SimpleNamespace(handlers={})
    core = Core(*cast(Any, (live, actions, None, None, "", "", "", (), None)))
    async with AsyncExitStack() as stack:
        await mount_extensions([_Describing(), _Gripper()], core, stack)
        assert _Describing.found == ["/gripper"]
