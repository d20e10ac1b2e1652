"""A client of the Model Context Protocol that sends what a test says, valid or not."""

import itertools
import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx

VERSION = "2025-11-25"
BOTH = "application/json, text/event-stream"
DEGREE = "http://qudt.org/vocab/unit/DEG"
Message = dict[str, Any]


class McpClient:
    """One session at ``/mcp`` below ``root``. ``heard``: the notifications of the last request."""

    def __init__(self, root: str, token: str = "") -> None:
        self.http = httpx.Client(timeout=900)
        self.url = root + "mcp"
        self.fields = {"accept": BOTH, "content-type": "application/json", "mcp-protocol-version": VERSION}
        if token:
            self.fields["authorization"] = f"Bearer {token}"
        self.heard: list[Message] = []
        self._ids = itertools.count(1)

    def open(self) -> Message:
        """Open a session and return the result of ``initialize``."""
        info = {"name": "test", "version": "1"}
        params = {"protocolVersion": VERSION, "capabilities": {}, "clientInfo": info}
        answer = self.post({"jsonrpc": "2.0", "id": 0, "method": "initialize", "params": params})
        assert answer.status_code == 200, answer.text
        self.fields["mcp-session-id"] = answer.headers["mcp-session-id"]
        assert self.post({"jsonrpc": "2.0", "method": "notifications/initialized"}).status_code == 202
        result: Message = _messages(answer)[-1]["result"]
        return result

    def post(self, message: object, **fields: str) -> httpx.Response:
        content = message if isinstance(message, bytes) else json.dumps(message).encode()
        return self.http.post(self.url, content=content, headers={**self.fields, **fields})

    def ask(self, method: str, params: Message | None = None, id: int | None = None) -> Message:
        """Return the response to a request."""
        number = next(self._ids) if id is None else id
        answer = self.post({"jsonrpc": "2.0", "id": number, "method": method, "params": params or {}})
        assert answer.status_code == 200, answer.text
        *self.heard, response = _messages(answer)
        assert response["id"] == number
        return response

    def call(self, tool: str, *, id: int | None = None, **arguments: object) -> Message:
        """Return the result of a tool call; its progress is in ``heard``."""
        params = {"name": tool, "arguments": arguments, "_meta": {"progressToken": "p"}}
        result: Message = self.ask("tools/call", params, id)["result"]
        return result

    def end(self) -> int:
        return self.http.delete(self.url, headers=self.fields).status_code


def text_of(result: Message) -> str:
    return "\n".join(each["text"] for each in result["content"])


def _messages(answer: httpx.Response) -> list[Message]:
    if answer.headers["content-type"].startswith("application/json"):
        return [answer.json()]
    lines = [line.removeprefix("data: ") for line in answer.text.splitlines() if line.startswith("data: ")]
    return [json.loads(line) for line in lines]


@contextmanager
def mcp_session(root: str, token: str = "") -> Iterator[McpClient]:
    speaker = McpClient(root, token)
    try:
        speaker.open()
        yield speaker
    finally:
        speaker.http.close()
