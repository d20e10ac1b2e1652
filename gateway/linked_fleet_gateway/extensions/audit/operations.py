"""Operations of the audit in OpenAPI."""

from linked_fleet_gateway.api import RequestView
from linked_fleet_gateway.extensions.audit.resources import PATH
from linked_fleet_gateway.extensions.openapi.api import Json, path_item, rdf_get_operation


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path item of the audit."""
    return {PATH: path_item({}, get=rdf_get_operation("readAudit", "Commands and changes, newest first"))}
