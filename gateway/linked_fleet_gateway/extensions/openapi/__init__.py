"""The extension ``openapi``: a description of the JSON interface (OpenAPI 3.1) for client generators and testers."""
