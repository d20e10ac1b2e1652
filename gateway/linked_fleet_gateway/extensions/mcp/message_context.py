"""The context of an MCP message: the request that carried it, and the fleet as its caller sees it."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass

from linked_fleet_base.errors import PROBLEM_JSON, BadRequest
from linked_fleet_gateway.api import Core, Request, RequestView, ask
from linked_fleet_gateway.serving import Reply

KEY = "linked-fleet.context"
"""Key of the message's ``MessageContext`` in ``scope["extensions"]``."""
MAX_REPLY_BYTES = 256 * 1024


@dataclass(frozen=True)
class MessageContext:
    """The context of one message.

    All changes are requests to the gateway with the caller's credentials.
    """

    request: Request
    view: RequestView
    core: Core
    ending: asyncio.Event
    """Set when the gateway ends."""

    def path_of(self, target: str) -> str:
        """Return the path of an IRI below any public URL of the fleet; a path as it is. Raises BadRequest."""
        for base in self.core.public_urls:
            if target == base or target.startswith(f"{base}/"):
                return target.removeprefix(base) or "/"
        if "://" in target:
            bases = " or ".join(f"{base}/" for base in self.core.public_urls)
            raise BadRequest(f"{target[:200]!r} is no path, such as /, and no URL below {bases}.")
        return target

    async def ask(
        self, method: str, target: str, accept: str, fields: Mapping[str, str] | None = None, content: bytes = b""
    ) -> Reply:
        """Return the gateway's response, with problems as JSON. Raises BadRequest and ReplyTooLong."""
        path, said = self.path_of(target), {"accept": f"{PROBLEM_JSON}, {accept}", **(fields or {})}
        return await ask(self.request, method, path, fields=said, content=content, longest=MAX_REPLY_BYTES)
