"""A survey of URDF files: which of them become robots of a fleet, and what the check of their motions covers.

``python -m strangers.survey FILE…`` prints one line of JSON for each file. Each takes the way of a real robot: the
agent loads it and describes it, the gateway takes the description, and the process of the check prepares its shapes.
"""

import json
import logging
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robots.catalogue import UnavailableError, load
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import Description
from linked_fleet_gateway.extensions.models.geometry import file_name
from linked_fleet_gateway.extensions.world.messages import CheckFailed, MeshesMissing, Prepare, PrepareMesh, Ready
from linked_fleet_gateway.extensions.world.worker import Worker
from linked_fleet_state.events import Appeared, Described
from linked_fleet_state.fleet import Fleet

_MINUTES = 30
_TESTS = Path(__file__).parents[1]


class Result(NamedTuple):
    """What became of one file.

    ``refusal`` is the sentence of the agent or gateway that refuses the robot, or empty. ``unchecked`` are the links
    that the check names, and ``silent`` those that have collision geometry, are not checked, and are not named.
    """

    file: str
    refusal: str = ""
    joints: int = 0
    findings: tuple[str, ...] = ()
    unchecked: tuple[str, ...] = ()
    silent: tuple[str, ...] = ()


def survey(file: Path) -> Result:
    """Return what becomes of a file."""
    try:
        agent = Agent("stranger", load("stranger", str(file)))
    except (UnavailableError, ValueError) as error:
        return Result(str(file), str(error))
    said, fleet = codec.decode(agent.description, Description), Fleet()
    fleet.apply(Appeared("stranger", said.incarnation), 1)
    fleet.apply(Described(said), 1)
    robot = fleet.robots["stranger"]
    if robot.model is None or robot.fault:
        return Result(str(file), f"the gateway: {robot.fault}")
    checked, unchecked = _covered(agent, said)
    colliding = [name for name, link in robot.model.links.items() if link.collisions]
    silent = tuple(name for name in colliding if name not in checked | set(unchecked))
    findings = tuple(finding.sentence for finding in robot.model.findings)
    return Result(str(file), "", len(said.joints), findings, tuple(unchecked), silent)


def _covered(agent: Agent, said: Description) -> tuple[set[str], dict[str, str]]:
    """Return the links that the check has shapes of, and those that it names as unchecked, with the reason."""
    worker, names = Worker.caching_in(None), {mesh.uri: file_name(mesh) for mesh in said.meshes}
    digests, unusable = {file_name(mesh): mesh.sha256 for mesh in said.meshes}, dict[str, str]()
    while True:
        answer = worker.answer(Prepare("stranger", said.urdf, names, unusable))
        if not isinstance(answer, MeshesMissing):
            break
        for name in answer.meshes:
            read = worker.answer(PrepareMesh(name, agent.mesh(digests[name].encode())))
            if isinstance(read, CheckFailed):
                unusable[name] = read.reason
    if not isinstance(answer, Ready):
        return set(), {"(all)": str(answer)}
    bodies = {body.link for body in worker._robots["stranger"].bodies}
    return bodies, {each.link: each.reason for each in answer.unchecked}


def surveyed(files: Sequence[Path]) -> Iterator[Result]:
    """Yield the result of each file. A process that dies at one is a refusal of it, and another one goes on."""
    left = list(files)
    while left:
        with tempfile.TemporaryFile("w+") as log:
            command = [sys.executable, "-m", "strangers.survey", *map(str, left)]
            done = subprocess.run(
                command, cwd=_TESTS, stdout=subprocess.PIPE, stderr=log, text=True, timeout=60 * _MINUTES
            )
            log.seek(0)
            said = (log.read().splitlines() or [""])[-1]
        found = [Result(**json.loads(line)) for line in done.stdout.splitlines() if line.startswith("{")]
        yield from found
        left = left[len(found) :]
        if left:
            yield Result(str(left.pop(0)), f"the process died: {done.returncode} {said}")


def is_robot(file: Path) -> bool:
    """Return True for a file whose root element is a robot, as far as it can be told; generated objects are none."""
    if "random_urdfs" in file.parts:
        return False
    try:
        return ElementTree.parse(file).getroot().tag.rpartition("}")[2] == "robot"
    except ElementTree.ParseError:
        return True


def urdf_files(folders: Iterable[Path]) -> list[Path]:
    return sorted(file for folder in folders for file in folder.rglob("*.urdf") if is_robot(file))


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    for name in sys.argv[1:]:
        print(json.dumps(survey(Path(name))._asdict()), flush=True)
