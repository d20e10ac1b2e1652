"""Forms with files: multipart/form-data (RFC 7578), as browsers and ``curl -F`` send it. Pure.

A form has a few fields whose names are known, each once. Parts have a header of one block; nested forms, and fields
that are in the header of the form alone, are refused.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass

_BOUNDARY = re.compile(
    r";\s*boundary=(?:\"([^\"\\]{1,70})\"|([0-9A-Za-z'()+_,\-./:=?]{1,70}))\s*(?:;|$)", re.IGNORECASE
)
_NAME = re.compile(r";\s*name=\"?([^\";\s]{1,100})\"?\s*(?:;|$)", re.IGNORECASE)
_FILE = re.compile(r";\s*filename=\"([^\"]{0,500})\"\s*(?:;|$)", re.IGNORECASE)
_LONGEST_HEADER = 1_024
_MOST_PARTS = 16


class BadForm(Exception):  # noqa: N818
    """The body is no such form. A sentence for the client."""


@dataclass(frozen=True)
class Part:
    """The value of a field. ``file_name`` is empty if the field is no file, or its name is not said."""

    content: bytes
    file_name: str = ""


def read_form(body: bytes, content_type: str, known: Collection[str]) -> dict[str, Part]:
    """Return the fields of a form by name. Raises BadForm with a sentence."""
    said = _BOUNDARY.search(content_type)
    if said is None:
        raise BadForm("The Content-Type of a form names its boundary: multipart/form-data; boundary=…")
    mark = b"--" + (said[1] or said[2]).encode("latin-1", "replace")
    found: dict[str, Part] = {}
    for raw in _raw_parts(body, mark):
        name, part = _part(raw)
        if name not in known:
            raise BadForm(f"The form has the field {name[:40]!r}; its fields are {', '.join(known)}.")
        if name in found:
            raise BadForm(f"The form has {name} twice.")
        found[name] = part
    return found


def _raw_parts(body: bytes, mark: bytes) -> list[bytes]:
    """Return what is between the boundaries. Raises BadForm."""
    at = 0 if body.startswith(mark) else body.find(b"\r\n" + mark) + 2
    if at == 1:
        raise BadForm("The body is no form: its boundary is not in it.")
    found: list[bytes] = []
    while True:
        begin = at + len(mark)
        if body[begin : begin + 2] == b"--":
            return found
        if body[begin : begin + 2] != b"\r\n" or len(found) == _MOST_PARTS:
            raise BadForm(f"A boundary ends its line, and a form has at most {_MOST_PARTS} fields.")
        end = body.find(b"\r\n" + mark, begin)
        if end < 0:
            raise BadForm("The form has no end; it may have been cut off.")
        found.append(body[begin + 2 : end])
        at = end + 2


def _part(raw: bytes) -> tuple[str, Part]:
    header, blank, content = raw.partition(b"\r\n\r\n")
    if not blank or len(header) > _LONGEST_HEADER:
        raise BadForm(
            f"A field of the form has a header of at most {_LONGEST_HEADER} bytes, and a blank line after it."
        )
    fields = {}
    for line in header.decode("utf-8", "replace").split("\r\n"):
        key, _, value = line.partition(":")
        fields[key.strip().lower()] = value.strip()
    if fields.get("content-transfer-encoding", "binary").lower() not in ("binary", "8bit", "7bit"):
        raise BadForm("A field of the form is in a transfer encoding; send it as it is.")
    said = fields.get("content-disposition", "")
    name, file = _NAME.search(said), _FILE.search(said)
    if not said.lower().startswith("form-data;") or name is None:
        raise BadForm('A field of the form has no name: Content-Disposition: form-data; name="…"')
    return name[1], Part(content, "" if file is None else re.split(r"[/\\]", file[1])[-1])
