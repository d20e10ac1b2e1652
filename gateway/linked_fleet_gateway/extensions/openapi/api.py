"""The contract of OpenAPI: names by which other extensions describe their operations (docs/EXTENDING.md)."""

from linked_fleet_gateway.extensions.openapi.containers import container_operations
from linked_fleet_gateway.extensions.openapi.operations import (
    CHANGED_RESPONSE,
    ID_SCHEMA,
    JSONLD,
    RDF_CONTENT,
    creation_responses,
    error_responses,
    get_operation,
    header_ref,
    parameter,
    patch_operation,
    path_item,
    rdf_get_operation,
    resource_path_items,
    segment_schema,
    write_operation,
)
from linked_fleet_gateway.faces import Json

__all__ = [
    "CHANGED_RESPONSE", "ID_SCHEMA", "JSONLD", "RDF_CONTENT", "Json", "container_operations", "creation_responses",
    "error_responses",
    "get_operation", "header_ref", "parameter", "patch_operation", "path_item", "rdf_get_operation",
    "resource_path_items", "segment_schema", "write_operation",
]  # fmt: skip
