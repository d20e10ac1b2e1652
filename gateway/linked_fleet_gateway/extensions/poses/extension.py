"""The extension ``poses``: positions of joints that people save under a name."""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from linked_fleet_base.settings import Section, setting, whole_number
from linked_fleet_gateway.api import Core, Extension, Mount, RequestView, gauge
from linked_fleet_gateway.extensions.poses.operations import operations
from linked_fleet_gateway.extensions.poses.saved import SEGMENT, Poses

HERE = Path(__file__).parent


@dataclass(frozen=True)
class PoseSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_POSES_"

    most: int = setting(whole_number(1, 10_000), "5000", "saved poses of the fleet")


class PosesExtension(Extension):
    """Poses at ``/{robot}/poses``."""

    name = "poses"
    in_robot = (SEGMENT,)
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    settings = PoseSettings

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.poses import page

        return page.VIEWS

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        poses = Poses(core, core.section(PoseSettings).most)
        with core.listening_to_descriptions(poses.described, poses.removed):
            async with poses.table:
                try:
                    yield Mount(
                        branches=(poses.branch,),
                        metrics=lambda: [gauge("saved_poses", "Saved poses of robots.", len(poses.table.known))],
                    )
                finally:
                    await poses.close()
