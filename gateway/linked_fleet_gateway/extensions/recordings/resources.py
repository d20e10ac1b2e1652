"""The recordings of a robot as resources, at ``/{robot}/recordings``."""

from collections.abc import Mapping

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import CONTAINER, Found, RequestView, Resource, RobotBranch, Source, robot_path
from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.recordings.folder import Recorded
from linked_fleet_gateway.extensions.recordings.reading import table_of
from linked_fleet_gateway.extensions.recordings.recorder import SEGMENT, Recorder, recordings_path
from linked_fleet_gateway.serving import Rendition
from linked_fleet_rdf.graph import SECOND, Graph, integer, timestamp
from linked_fleet_rdf.vocabulary import DCTERMS, LDP, LF, RDFS
from linked_fleet_state.robot import Robot

TERMS = "https://w3id.org/linked-fleet/recordings#"
RECORDING, RECORDING_LIST = NamedNode(TERMS + "Recording"), NamedNode(TERMS + "RecordingList")


def recordings_branch(recorder: Recorder) -> RobotBranch:
    """Return the branch of the recordings of each robot that has some."""

    def resolve(view: RequestView, robot: Robot, rest: list[str]) -> Found:
        known = recorder.of(robot.name)
        if not rest:
            return _list(view, robot.name, known)
        if len(rest) > 1 or rest[0] not in known:
            return None
        return _one(view, robot.name, rest[0], known[rest[0]])

    return RobotBranch(SEGMENT, NamedNode(TERMS + SEGMENT), resolve, lambda robot: bool(recorder.of(robot.name)))


def _list(view: RequestView, robot: str, known: Mapping[str, Recorded]) -> Resource:
    path, title = recordings_path(robot), f"Recordings of {robot}"

    def describe(graph: Graph) -> None:
        iri = view.iri(path)
        graph.a(iri, RECORDING_LIST, LDP.BasicContainer, LDP.Container)
        graph.add(iri, DCTERMS.title, Literal(title))
        graph.add(iri, RDFS.seeAlso, view.iri(robot_path(robot)))
        for id, each in known.items():
            graph.add(iri, LDP.contains, view.iri(f"{path}/{id}"))
            _describe(graph, view.iri(f"{path}/{id}"), robot, each)

    members = tuple(f"{path}/{id}" for id in known)
    return Resource(path, title, describe, CONTAINER, Source(lambda: tuple(known)), part_paths=members)


def _one(view: RequestView, robot: str, id: str, recorded: Recorded) -> Resource:
    path = f"{recordings_path(robot)}/{id}"
    name = path[1:].replace("/", "-")

    def describe(graph: Graph) -> None:
        _describe(graph, view.iri(path), robot, recorded)
        graph.add(view.iri(path), RDFS.seeAlso, view.iri(robot_path(robot)))

    return Resource(
        path,
        f"Recording of {robot}",
        describe,
        source=Source(lambda: id),
        documents={
            MCAP: Rendition(recorded.read, f"{name}.mcap", is_long=True),
            CSV: Rendition(lambda: table_of(robot, recorded.read()), f"{name}.csv", is_long=True),
        },
        publishes_changes=False,
    )


def _describe(graph: Graph, iri: NamedNode, robot: str, recorded: Recorded) -> None:
    graph.a(iri, RECORDING)
    graph.add(iri, DCTERMS.title, Literal(f"Recording of {robot}"))
    graph.add(iri, DCTERMS.created, timestamp(recorded.at_ns))
    graph.add(iri, DCTERMS.format, Literal(MCAP))
    if not recorded.size:
        graph.add(iri, LF.reason, Literal("The file is damaged."))
        return
    graph.add(iri, DCTERMS.description, Literal(recorded.says))
    graph.scalar(iri, LF.duration, recorded.length_s, SECOND)
    graph.add(iri, LF.byteSize, integer(recorded.size))
