"""The extension ``things``: Thing Descriptions and their directory (W3C Web of Things)."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from linked_fleet_gateway.extensions.things.directory import BRANCHES, Listing
from linked_fleet_gateway.extensions.things.http import read_listing
from linked_fleet_gateway.extensions.things.td import TD
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.html import NavigationEntry


class ThingsExtension(Extension):
    name = "things"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    at_root = (".well-known", "things")
    views = ("linked_fleet_gateway.extensions.things.page:VIEW",)
    navigation = (NavigationEntry("Things", "/things", 60),)
    operations = ("linked_fleet_gateway.extensions.things.operations:operations",)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        yield Mount(branches=BRANCHES, readers={Listing: read_listing}, formats={"td": ("Thing Description", TD)})
