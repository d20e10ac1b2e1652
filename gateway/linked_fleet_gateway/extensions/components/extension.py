"""The extension ``components``: parts of robots that are more than joints, with values, actions and events."""

import asyncio
import logging
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

from pyoxigraph import Literal

from linked_fleet_gateway.api import (
    Core,
    Extension,
    Found,
    Graph,
    InSteps,
    Mount,
    NamedNode,
    RequestView,
    Resource,
    Robot,
    RobotBranch,
    Source,
    cancel_tasks,
    robot_path,
    supervised,
)
from linked_fleet_gateway.extensions.components.part import ComponentPart
from linked_fleet_gateway.extensions.components.receipt import Receipt
from linked_fleet_gateway.extensions.components.streams import Streams
from linked_fleet_gateway.extensions.components.terms import LF
from linked_fleet_gateway.faces import Invoke
from linked_fleet_rdf.vocabulary import OWL

log = logging.getLogger(__name__)

SEGMENT = "vocabulary"
_SWEEP_S = 0.25


def _components(robot: Robot) -> list[ComponentPart]:
    return [each for each in robot.parts.values() if isinstance(each, ComponentPart)]


def _stopped(robot: Robot) -> Iterator[tuple[NamedNode, Literal]]:
    """Yield why a protective stop keeps a robot from moving, for the list of robots."""
    for each in _components(robot):
        if each.declared.semantic_type == LF.Mode.value and each.is_current and each.state.value("protectiveStop"):
            yield LF.stopped, Literal(str(each.state.value("reason") or "a protective stop is active")[:200])
            return


def _resolve(view: RequestView, robot: Robot, rest: list[str]) -> Found:
    if rest:
        return None
    return Resource(
        robot_path(robot.name) + SEGMENT,
        f"Vocabulary of {robot.name}",
        InSteps(partial(_describe, view.base, robot)),
        source=Source(lambda: (robot.description, len(robot.parts)), robot=robot),
    )


def _describe(base: str, robot: Robot, graph: Graph) -> Iterator[None]:
    """Describe the terms of a robot's own, one component in each step."""
    graph.a(NamedNode(base + robot_path(robot.name) + SEGMENT), OWL.Ontology)
    for part in _components(robot):
        yield
        part.compiled(base).describe_terms(graph)


class ComponentsExtension(Extension):
    name = "components"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    introductions = (_stopped,)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.components import page

        return (page.VIEW,)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        receipt, streams = Receipt(core), Streams(core)

        async def sweep() -> None:
            await asyncio.sleep(_SWEEP_S)
            receipt.expire()

        task = supervised(sweep, "stale values of components", log, "values may stay although they are old", 0.0)
        with core.listening_to_descriptions(receipt.describe, receipt.forget):
            try:
                yield Mount(
                    branches=(RobotBranch(SEGMENT, LF.vocabulary, _resolve, lambda robot: bool(_components(robot))),),
                    websocket_handlers={Invoke: streams.handler},
                )
            finally:
                await streams.close()
                await cancel_tasks([task])
                await receipt.close()
