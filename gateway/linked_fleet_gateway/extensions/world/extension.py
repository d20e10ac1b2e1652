"""The extension ``world``: placements, objects and zones, poses between frames, and collision checks of motions."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

from linked_fleet_gateway.extensions.world.http import post_object, put_object, read_pose
from linked_fleet_gateway.extensions.world.resources import PoseQuery, PostObject, PutObject
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.html import NavigationEntry

PREPARING = "the shapes of robots are being prepared for the check of their motions"


class WorldExtension(Extension):
    name = "world"
    at_root = ("world",)
    in_robot = ("placement",)
    robot_properties = ("linked_fleet_gateway.extensions.world.placement:placement",)
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    placements = ("linked_fleet_gateway.extensions.world.placement:placement_of",)
    views = (
        "linked_fleet_gateway.extensions.world.page:VIEW",
        "linked_fleet_gateway.extensions.world.page:COLLISIONS_VIEW",
        "linked_fleet_gateway.extensions.world.page:CONTAINER_VIEW",
        "linked_fleet_gateway.extensions.world.page:OBJECT_VIEW",
    )
    operations = ("linked_fleet_gateway.extensions.world.operations:operations",)
    navigation = (NavigationEntry("World", "/world", 10),)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        async with World(core.live, core.redis_url, core.namespace, core.state_path / "meshes") as world:
            yield Mount(
                branches=(world.branch,),
                readers={PoseQuery: partial(read_pose, world)},
                writers={PostObject: partial(post_object, world), PutObject: partial(put_object, world)},
                guard=world.checks,
                services=(world,),
                not_ready=lambda: "" if world.checks.prepared else PREPARING,
            )
