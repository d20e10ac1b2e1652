"""The scripts and styles of pages as resources below ``/assets``, and a thumbnail of each robot."""

from linked_fleet_gateway.extensions.pages.assets import assets
from linked_fleet_gateway.extensions.pages.thumbnail import SVG, drawing
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.vocabulary import LDP
from linked_fleet_gateway.resources.branches import FleetBranch, RequestView, RobotBranch
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_gateway.resources.resource import Resource

THUMBNAIL = "thumbnail"


def _asset(view: RequestView, rest: list[str]) -> Resource | None:
    found = assets().files.get("/".join(rest))
    if found is None:
        return None
    path, documents = "/assets/" + "/".join(rest), {found.media_type: lambda: found.content}
    return Resource(path, rest[-1], None, (LDP.Resource,), documents=documents, immutable=True, coded=found.coded)


def _thumbnail(view: RequestView, robot: Robot, rest: list[str]) -> Resource | None:
    if rest:
        return None
    path, title = robot_path(robot.name) + THUMBNAIL, f"Thumbnail of {robot.name}"
    return Resource(path, title, None, (LDP.Resource,), documents={SVG: lambda: drawing(robot)})


BRANCH = FleetBranch("assets", None, _asset)
THUMBNAILS = RobotBranch(THUMBNAIL, None, _thumbnail)
