"""The extension ``availability``: robots in service and out of it."""

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

from prometheus_client.metrics_core import Metric

from linked_fleet_gateway.api import Core, Extension, Mount, gauge
from linked_fleet_gateway.extensions.availability.availability import (
    AVAILABILITY,
    availability,
    introduction,
    out_of_service,
)

HERE = Path(__file__).parent


class AvailabilityExtension(Extension):
    """Adds the property ``availability`` to each robot."""

    name = "availability"
    in_robot = (AVAILABILITY,)
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    robot_properties = (availability,)
    introductions = (introduction,)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        def metrics() -> Iterator[Metric]:
            out = [each for each in list(core.robots.values()) if out_of_service(each) is not None]
            yield gauge("robots_out_of_service", "Robots that people have taken out of service.", len(out))

        yield Mount(metrics=metrics)
