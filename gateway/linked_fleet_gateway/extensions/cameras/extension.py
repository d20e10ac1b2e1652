"""The extension ``cameras``: cameras of robots as resources, their pictures, and streams of them."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

from linked_fleet_gateway.extensions.cameras.http import read_camera
from linked_fleet_gateway.extensions.cameras.pictures import Pictures
from linked_fleet_gateway.extensions.cameras.resources import RobotCamera, cameras_branch
from linked_fleet_gateway.http.extension import Core, Extension, Mount


class CamerasExtension(Extension):
    name = "cameras"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    in_robot = ("cameras",)
    link_statements = ("linked_fleet_gateway.extensions.cameras.resources:mounted_cameras",)
    operations = ("linked_fleet_gateway.extensions.cameras.operations:operations",)
    views = ("linked_fleet_gateway.extensions.cameras.page:VIEW",)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        async with Pictures(core.live) as pictures:
            yield Mount(
                branches=(cameras_branch(pictures.held),),
                readers={RobotCamera: partial(read_camera, pictures)},
                subprotocols={"lf.jpeg": "image/jpeg", "lf.png": "image/png"},
                services=(pictures,),
            )
