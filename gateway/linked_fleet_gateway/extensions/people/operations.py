"""Operations of people in OpenAPI."""

from linked_fleet_gateway.api import RequestView
from linked_fleet_gateway.extensions.openapi.api import Json, path_item, rdf_get_operation
from linked_fleet_gateway.extensions.people.resources import PATH


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path item of the people. Requests for control are a container, which has its own."""
    return {PATH: path_item({}, get=rdf_get_operation("readPeople", "Who is here, and who controls which robot"))}
