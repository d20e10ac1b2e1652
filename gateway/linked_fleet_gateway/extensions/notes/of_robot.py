"""The notes about one robot, its parts and its faults, as a resource at ``/{robot}/notes``."""

from collections.abc import Iterator

from linked_fleet_gateway.api import (
    CONTAINER,
    DCTERMS,
    LDP,
    RDFS,
    Container,
    Found,
    Graph,
    InSteps,
    Literal,
    Member,
    RequestView,
    Resource,
    Robot,
    RobotBranch,
    Source,
    blueprint_of,
    robot_path,
)
from linked_fleet_gateway.extensions.notes.note import Note
from linked_fleet_gateway.extensions.notes.terms import LF
from linked_fleet_rdf.vocabulary import HYBRIT

SEGMENT = "notes"


def notes_path(robot: str) -> str:
    return robot_path(robot) + SEGMENT


def notes_of_robots(notes: Container[Note]) -> RobotBranch:
    def resolve(view: RequestView, robot: Robot, rest: list[str]) -> Found:
        whole = _whole(notes, view, robot)
        if rest == ["blueprint"]:
            return blueprint_of(whole, view.base, (LF.RobotNotesShape,))
        return None if rest else whole

    return RobotBranch(SEGMENT, LF.notesOfRobot, resolve)


def _whole(notes: Container[Note], view: RequestView, robot: Robot) -> Resource:
    path, title = notes_path(robot.name), f"Notes about {robot.name}"

    def members() -> list[Member[Note]]:
        return [each for each in notes.members(view) if robot.name in each.record.robots]

    def steps(graph: Graph) -> Iterator[None]:
        iri = view.iri(path)
        graph.a(iri, LF.RobotNotes, LDP.BasicContainer, LDP.Container)
        graph.add(iri, DCTERMS.title, Literal(title))
        graph.add(iri, RDFS.seeAlso, view.iri(robot_path(robot.name)), view.iri(notes.path))
        graph.add(iri, HYBRIT.blueprint, view.iri(f"{path}/blueprint"))
        for each in members():
            graph.add(iri, LDP.contains, each.iri)
            each.describe(graph)
            yield

    own = (f"{path}/blueprint",)
    source = Source(lambda: [(each.id, each.record) for each in members()])
    return Resource(path, title, InSteps(steps), CONTAINER, source, own_paths=own)
