"""The tokens of SPARQL, of queries and updates (SPARQL 1.1 Query Language, 19.8), within limits."""

import re
from typing import NamedTuple

from linked_fleet_base.errors import BadRequest, PayloadTooLarge

MAX_QUERY_BYTES = 32 * 1024
MAX_DEPTH = 64

# Strings are consumed whole, closed or not, so that hostile input takes one pass. Prefixes are limited to 64 characters
# for the same reason.
_TOKEN = re.compile(
    r"""(?P<space>[\x20\t\r\n]+|\#[^\r\n]*+)
    |(?P<iri><(?:[^<>"{}|^`\\\x00-\x20]|\\u[0-9A-Fa-f]{4}|\\U[0-9A-Fa-f]{8})*+>)
    |(?P<string>\"{3}(?:\\.|(?!\"{3}).)*+(?:\"{3})?|'{3}(?:\\.|(?!'{3}).)*+(?:'{3})?
        |"(?:\\.|[^"\\\r\n])*+"?|'(?:\\.|[^'\\\r\n])*+'?)
    |(?P<variable>[?$]\w+)
    |(?P<language>@[A-Za-z][A-Za-z0-9-]*+)
    |(?P<name>_:[\w.·-]++|(?:[^\W\d_][\w.·-]{0,63}+)?:(?:[\w.:·-]|%[0-9A-Fa-f]{2}|\\.)*+)
    |(?P<word>[A-Za-z_]\w*+)
    |(?P<number>[0-9.]++(?:[eE][+-]?+[0-9]++)?)
    |(?P<open>[({\[])
    |(?P<close>[)}\]])
    |(?P<other>.)""",
    re.VERBOSE | re.DOTALL,
)

_NO_TEXT = re.compile("[\0\ud800-\udfff]")


class Token(NamedTuple):
    kind: str
    text: str
    start: int

    @property
    def word(self) -> str:
        """The token as a keyword in capitals; empty for other tokens."""
        return self.text.upper() if self.kind == "word" else ""


def syntax_error(detail: str, text: str, token: Token) -> BadRequest:
    """Return an error with line and column of the token, from 1."""
    before = text[: token.start]
    return BadRequest(detail, line=before.count("\n") + 1, column=token.start - before.rfind("\n"))


def tokenize(text: str) -> list[Token]:
    """Return all tokens except white space and comments; bounded in length and nesting."""
    if len(text.encode("utf-8", "surrogatepass")) > MAX_QUERY_BYTES:
        raise PayloadTooLarge(f"The query has more than {MAX_QUERY_BYTES} bytes.")
    if _NO_TEXT.search(text):
        raise BadRequest("The query has characters in it that no text has.")
    tokens: list[Token] = []
    depth = 0
    for match in _TOKEN.finditer(text):
        kind = match.lastgroup or ""
        if kind == "space":
            continue
        token = Token(kind, match[0], match.start())
        tokens.append(token)
        depth += (kind == "open") - (kind == "close")
        if depth > MAX_DEPTH:
            raise syntax_error(f"Brackets are nested more than {MAX_DEPTH} deep.", text, token)
    return tokens
