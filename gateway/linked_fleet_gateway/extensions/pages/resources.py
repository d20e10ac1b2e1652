"""The scripts and styles of pages as resources below ``/assets``."""

from linked_fleet_gateway.extensions.pages.assets import assets
from linked_fleet_gateway.rdf.vocabulary import LDP
from linked_fleet_gateway.resources.branches import FleetBranch, RequestView
from linked_fleet_gateway.resources.resource import Resource


def _asset(view: RequestView, rest: list[str]) -> Resource | None:
    found = assets().files.get("/".join(rest))
    if found is None:
        return None
    path, documents = "/assets/" + "/".join(rest), {found.media_type: lambda: found.content}
    return Resource(path, rest[-1], None, (LDP.Resource,), documents=documents, immutable=True, coded=found.coded)


BRANCH = FleetBranch("assets", None, _asset)
