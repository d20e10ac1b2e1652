"""Operations of containers, which follow from their shapes."""

from types import MappingProxyType
from typing import Any

from linked_fleet_gateway.api import Container
from linked_fleet_gateway.extensions.openapi.operations import (
    CHANGED_RESPONSE,
    ID_SCHEMA,
    Parameters,
    creation_responses,
    header_ref,
    patch_operation,
    resource_path_items,
    write_operation,
)
from linked_fleet_gateway.faces import Json
from linked_fleet_rdf.serialise import JSON

_ADDED: Json = creation_responses("Added.") | {
    "204": {"description": "Checked, as preferred by dry-run; nothing was added."}
}


def container_operations(
    container: Container[Any], template: str = "", parameters: Parameters = MappingProxyType({})
) -> dict[str, Json]:
    """Return the path items (OpenAPI 3.1, 4.8.9) of a container and its members.

    Containers alike share the ``template`` of their paths, with the schemas of its ``parameters``.
    """
    template, one = template or container.path, {**parameters, "id": ID_SCHEMA}
    name = container.member_type.value.rpartition("#")[2].rpartition("/")[2]
    member = f"{template}/{{id}}"
    delete = write_operation(f"delete{name}", "Delete it", CHANGED_RESPONSE, None, [header_ref("IfMatch")])
    if not container.by_clients:
        return {
            **resource_path_items(template, parameters, f"{name}Container", container.title),
            **resource_path_items(member, one, name, f"A member of {container.title}", delete=delete),
        }
    body: Json = {JSON: {"schema": container.form_at("").schema}}
    return {
        **resource_path_items(
            template, parameters, f"{name}Container", container.title,
            post=write_operation(f"add{name}", f"Add to {container.title}", _ADDED, body, [header_ref("Prefer")]),
        ),
        **resource_path_items(
            member, one, name, f"A member of {container.title}",
            put=write_operation(
                f"put{name}", "Replace it", CHANGED_RESPONSE, body, [header_ref("Prefer"), header_ref("IfMatch")]
            ),
            patch=patch_operation(f"patch{name}", "Change it by a SPARQL update"),
            delete=delete,
        ),
    }  # fmt: skip
