"""Extensions declare the operations of their resources, and every description of the gateway includes them."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from types import SimpleNamespace
from typing import Any, ClassVar, cast

from linked_fleet_gateway.app.extensions import mount_extensions
from linked_fleet_gateway.base.faults import Faults
from linked_fleet_gateway.http.extension import Core, Extension, Mount


class _Gripper(Extension):
    name = "gripper"
    operations = ("acme.gripper:operations",)


class _Describing(Extension):
    name = "describing"
    found: ClassVar[list[str]] = []

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        self.found[:] = core.operations
        yield Mount()


async def test_descriptions_include_operations_of_extensions_started_later() -> None:
    live = SimpleNamespace(add_branches=lambda *_: None, faults=Faults())
    actions = SimpleNamespace(handlers={})
    core = Core(*cast(Any, (live, actions, None, None, "", "", "", (), None)))
    async with AsyncExitStack() as stack:
        await mount_extensions([_Describing(), _Gripper()], core, stack)
        assert _Describing.found == ["acme.gripper:operations"]
