"""The extension ``patch``: PATCH by a SPARQL update of the description of one resource (RFC 5789; LDP 4.2.7)."""

from linked_fleet_gateway.api import Extension
from linked_fleet_gateway.extensions.patch.sparql_update import read_patch


class PatchExtension(Extension):
    name = "patch"
    patches = {"application/sparql-update": read_patch}  # noqa: RUF012 - nobody changes it
