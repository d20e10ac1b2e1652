"""OpenAPI: a description of the gateway's JSON for generators of clients and for testers (OpenAPI 3.1)."""
