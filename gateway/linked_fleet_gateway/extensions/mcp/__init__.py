"""The Model Context Protocol: the fleet for programs that plan in language, over streamable HTTP at ``/mcp``."""
