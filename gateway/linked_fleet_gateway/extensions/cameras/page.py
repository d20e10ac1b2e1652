"""The pages of cameras: one camera, those of a robot, and those of all robots, each with what it sees."""

from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import NamedNode

from linked_fleet_gateway.api import LDP, RDFS
from linked_fleet_gateway.extensions.cameras.resources import LF, PATH
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part
from linked_fleet_gateway.extensions.pages.languages import message, say
from linked_fleet_gateway.extensions.pages.thing_views import AROUND, PRESENCE, presence


def camera(facts: Facts, iri: NamedNode) -> Part:
    """Show the picture, which has the URL of the camera, or the reason for having none."""
    there = facts.one(iri, LF.picture) == iri
    more = {
        "presence": presence(facts, iri),
        "picture": iri.value if there else "",
        "width": facts.text(iri, LF.imageWidth),
        "height": facts.text(iri, LF.imageHeight),
        "reason": facts.text(iri, LF.reason),
    }
    return Part(more, {*PRESENCE, *AROUND, *((LF.picture,) if there else ())})


@dataclass(frozen=True)
class Seen:
    """A camera among others. ``robot``: whose it is, where that is not plain. ``reason``: why it has no pictures."""

    link: Link
    robot: Link | None
    reason: str


def cameras(facts: Facts, iri: NamedNode) -> Part:
    """Show what each camera sees; scripts fetch the pictures of those in view."""
    members = facts.nodes(iri, LDP.contains)
    robots = [facts.one(each, LF.ofRobot) for each in members]
    seen = [
        Seen(
            facts.link(each),
            facts.place_link(robot) if isinstance(robot, NamedNode) else None,
            facts.text(each, LF.reason),
        )
        for each, robot in zip(members, robots, strict=True)
    ]
    robot = next((each.value for each in facts.nodes(iri, RDFS.seeAlso)), "")
    title = say("Cameras of {robot}", robot=texts.place(robot, facts.root)) if robot else ""
    return Part({"cameras": seen, "all": facts.root + PATH[1:]}, {LDP.contains, RDFS.seeAlso}, {*members}, title)


_TEMPLATES = Path(__file__).parent / "templates"
VIEWS = (
    PageView(
        LF.Camera,
        _TEMPLATES / "camera.html",
        camera,
        help=message("The live picture of one camera, and how it sees."),
        guide="docs/DESCRIPTIONS.md",
    ),
    PageView(
        LF.Cameras,
        _TEMPLATES / "cameras.html",
        cameras,
        help=message("The live pictures of all cameras of this robot."),
        guide="docs/DESCRIPTIONS.md",
    ),
    PageView(
        LF.FleetCameras,
        _TEMPLATES / "fleet_cameras.html",
        cameras,
        help=message("The live pictures of all cameras of this fleet."),
        guide="docs/DESCRIPTIONS.md",
    ),
)
