"""Facts of mesh files that their loader does not regard: the unit of a COLLADA file, and the parts of a binary glTF.

Files are in their own axes, as usual with URDFs: neither ``up_axis`` of COLLADA nor the upward y of glTF turns them.
"""

import json
import struct
from io import BytesIO
from typing import Any
from xml.etree import ElementTree

from linked_fleet_state.xml import ModelError

_LEAST_M, _MOST_M = 1e-9, 1e9
_HEAD, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")
_ALIGNED = 4


def collada_unit_m(content: bytes) -> float:
    """Return the length unit of a COLLADA file in metre (COLLADA 1.4.1, ``unit``); 1 if it states none.

    Raises ModelError.
    """
    depth = 0
    try:
        for event, element in ElementTree.iterparse(BytesIO(content), ("start", "end")):  # noqa: S314 - expat is bounded
            depth += 1 if event == "start" else -1
            if event == "end" and depth == 1 and _local_name(element) == "asset":
                return _unit_of(element)
    except (ElementTree.ParseError, ValueError) as error:
        raise ModelError(f"it is no well-formed XML: {error}") from error
    return 1.0


def _unit_of(asset: ElementTree.Element) -> float:
    unit = next((each for each in asset if _local_name(each) == "unit"), None)
    text = "1" if unit is None else unit.get("meter", "1")
    try:
        metre = float(text)
    except ValueError as error:
        raise ModelError(f"its unit of {text[:40]!r} metre is no number") from error
    if not _LEAST_M <= metre <= _MOST_M:
        raise ModelError(f"its unit is {metre:g} m, which is out of all bounds")
    return metre


def _local_name(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def with_plain_root(content: bytes) -> bytes:
    """Return a binary glTF whose scene has one root node without a transformation: Coal ignores that of a root.

    Raises ModelError if it refers to other files, or needs an extension (glTF 2.0, 3.12).
    """
    document, rest = _read(content)
    if needed := document.get("extensionsRequired"):
        raise ModelError(f"it needs the glTF extensions {json.dumps(needed)[:100]}")
    try:
        for kind in ("buffers", "images"):
            if any(not str(each.get("uri", "data:")).startswith("data:") for each in document.get(kind, ())):
                raise ModelError(f"its {kind} are in other files")
        scene = document["scenes"][document.get("scene", 0)]
        document["nodes"].append({"children": scene["nodes"]})
        scene["nodes"] = [len(document["nodes"]) - 1]
    except (LookupError, AttributeError, TypeError) as error:
        raise ModelError("it has no scene") from error
    return _written(document, rest)


def _read(content: bytes) -> tuple[dict[str, Any], bytes]:
    """Return the document of a binary glTF, and the chunks after it."""
    try:
        magic, version, _ = _HEAD.unpack_from(content)
        size, kind = _CHUNK.unpack_from(content, _HEAD.size)
        end = _HEAD.size + _CHUNK.size + size
        if magic != b"glTF" or version != 2 or kind != b"JSON" or end > len(content):
            raise ModelError("it is no binary glTF 2.0")
        found = json.loads(content[_HEAD.size + _CHUNK.size : end])
    except (struct.error, ValueError, RecursionError) as error:
        raise ModelError("it is no binary glTF 2.0") from error
    if not isinstance(found, dict):
        raise ModelError("it is no binary glTF 2.0")
    return found, content[end:]


def _written(document: dict[str, Any], rest: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % _ALIGNED)
    chunks = _CHUNK.pack(len(text), b"JSON") + text + rest
    return _HEAD.pack(b"glTF", 2, _HEAD.size + len(chunks)) + chunks
