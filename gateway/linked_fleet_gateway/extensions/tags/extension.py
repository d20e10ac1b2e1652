"""The extension ``tags``: words by which people group robots."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from linked_fleet_gateway.api import Core, Extension, Mount
from linked_fleet_gateway.extensions.tags.tags import TAGS, introduction, tags

HERE = Path(__file__).parent


class TagsExtension(Extension):
    """Adds the property ``tags`` to each robot."""

    name = "tags"
    in_robot = (TAGS,)
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    robot_properties = (tags,)
    introductions = (introduction,)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        yield Mount()
