"""The extension ``mcp``: the fleet as tools for language models (Model Context Protocol), over HTTP at ``/mcp``."""
