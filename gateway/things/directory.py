"""Where Thing Descriptions are found (W3C WoT Discovery): ``/.well-known/wot`` and the directory ``/things``."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from gateway.fleet.model import Joint, Link
from gateway.fleet.robot import Robot
from gateway.graph.paths import part_of, robot_name
from gateway.graph.resource import Resource
from gateway.graph.vocab import LDP, LF
from gateway.graph.wing import FleetWing, Found, Sight
from gateway.things.documents import DIRECTORY, TD, of_thing

Place = tuple[Robot | None, Joint | Link | None]


@dataclass(frozen=True)
class Listing:
    """All things that who asks may see, a part of them at a time (``gateway.http.things``)."""

    sight: Sight

    def written(self, offset: int, limit: int) -> Iterator[bytes]:
        """At most so many Thing Descriptions, each made when its turn comes."""
        return (of_thing(self.sight, *place)[TD]() for place in islice(self._places(offset), limit))

    def _places(self, skipped: int) -> Iterator[Place]:
        """The fleet, then each robot with its joints and links; of robots that are skipped nothing is looked at."""
        if skipped == 0:
            yield None, None
        skipped = max(0, skipped - 1)
        for _, robot in sorted(self.sight.robots.items()):
            model = robot.model
            count = 1 if model is None else 1 + len(model.joints) + len(model.links)
            if skipped < count:
                parts: list[Joint | Link | None] = [None]
                if model is not None:
                    parts += [*model.joints.values(), *model.links.values()]
                yield from ((robot, part) for part in parts[skipped:])
            skipped = max(0, skipped - count)


def _entrance(sight: Sight, rest: Sequence[str]) -> Found:
    if list(rest) != ["wot"]:
        return None
    return Resource("/.well-known/wot", "Thing Description", None, (LDP.Resource,), documents=of_thing(sight))


def _directory(sight: Sight, rest: Sequence[str]) -> Found:
    """The listing, or what has the id that follows: the IRI of a thing."""
    if not rest:
        return Resource(DIRECTORY, "Thing Descriptions", None, (LDP.Resource,), remote=Listing(sight), followed=False)
    id = "/".join(rest)
    place = _place(sight, id.removeprefix(sight.base)) if id.startswith(sight.base + "/") else None
    if place is None:
        return None
    return Resource(
        f"{DIRECTORY}/{id}", f"Thing Description of {id}", None, (LDP.Resource,), documents=of_thing(sight, *place)
    )


def _place(sight: Sight, path: str) -> Place | None:
    if path == "/":
        return None, None
    head, _, part = path[1:].partition("/")
    try:
        robot = sight.robots.get(robot_name(head))
        if robot is None or not part:
            return (robot, None) if robot is not None and path.endswith("/") else None
        if robot.model is None:
            return None
        joint, link = part_of(part, robot.model)
    except ValueError:
        return None
    return robot, (robot.model.joints[joint] if joint is not None else robot.model.links[link or ""])


WINGS = (FleetWing(".well-known", None, _entrance), FleetWing(DIRECTORY[1:], LF.things, _directory))
