"""The scripts and styles of the pages below ``/assets``, and thumbnails of robots, as resources."""

from linked_fleet_gateway.api import FleetBranch, RequestView, Resource, Robot, RobotBranch, robot_path
from linked_fleet_gateway.extensions.pages.assets import THUMBNAIL, find_asset
from linked_fleet_gateway.extensions.pages.thumbnail import SVG, drawing
from linked_fleet_gateway.serving import Rendition
from linked_fleet_rdf.vocabulary import LDP


def _asset(view: RequestView, rest: list[str]) -> Resource | None:
    found = find_asset("/".join(rest))
    if found is None:
        return None
    documents = {found.media_type: Rendition(lambda: found.content, codings=found.coded)}
    return Resource("/assets/" + "/".join(rest), rest[-1], None, (LDP.Resource,), documents=documents, immutable=True)


def _thumbnail(view: RequestView, robot: Robot, rest: list[str]) -> Resource | None:
    if rest:
        return None
    path, title = robot_path(robot.name) + THUMBNAIL, f"Thumbnail of {robot.name}"
    return Resource(path, title, None, (LDP.Resource,), documents={SVG: lambda: drawing(robot)})


ASSETS = FleetBranch("assets", None, _asset)
THUMBNAILS = RobotBranch(THUMBNAIL, None, _thumbnail)
