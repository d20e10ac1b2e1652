"""Patch: PATCH of a resource by a SPARQL update of its description."""
