"""Responses of the gateway as tool results. A refusal contains everything needed to correct the request."""

import json
from base64 import b64encode
from typing import Any

from mcp_types import CallToolResult, ContentBlock, ImageContent, TextContent

from linked_fleet_gateway.http.internal_request import Reply


def content_result(reply: Reply, note: str = "") -> CallToolResult:
    """Return the content unchanged, preceded by ``note``; a refusal becomes an error."""
    if reply.status >= 400:
        return refusal_result(reply.problem, note)
    media_type, text = reply.media_type, ""
    content: list[ContentBlock] = [TextContent(text=note)] if note else []
    if media_type.startswith("image/"):
        content.append(ImageContent(data=b64encode(reply.content).decode(), mime_type=media_type))
    elif reply.content and not is_text(media_type):
        return failure_result(f"This is {media_type} of {len(reply.content)} bytes; read it by HTTP.")
    elif text := reply.content.decode():
        content.append(TextContent(text=text))
    value = json.loads(text) if text and "json" in media_type else None
    return CallToolResult(content=content, structured_content=value if isinstance(value, dict) else None)


def is_text(media_type: str) -> bool:
    return media_type.startswith("text/") or media_type.endswith("json")


def refusal_result(problem: dict[str, Any], note: str = "") -> CallToolResult:
    """Return a tool error, as sentences and as problem details."""
    sentences = [note, f"{problem['title']} ({problem['status']}). {problem.get('detail', '')}"]
    for result in problem.get("report", ()):
        value = f" (it was {result['value']})" if "value" in result else ""
        sentences.append(f"- {result.get('path', 'the body')}: {result.get('message', 'not allowed')}{value}")
    if constraint := problem.get("constraint"):
        sentences.append(f"{constraint} says what would be right.")
    return failure_result("\n".join(each.strip() for each in sentences if each), problem)


def failure_result(text: str, structured: dict[str, Any] | None = None) -> CallToolResult:
    return CallToolResult(content=[TextContent(text=text)], structured_content=structured, is_error=True)
