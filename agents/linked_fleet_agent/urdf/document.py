"""The XML of a description: bytes and text as they are in the field, to a bounded tree of URDF elements.

Names are read without namespaces. Elements and attributes with a prefix belong to other tools and are left out, whether
their prefix is declared or not. The elements without prefix are those of URDF, whichever default namespace they have.
"""

import codecs
import logging
import re
from typing import Final
from xml.etree.ElementTree import Element
from xml.parsers import expat

from linked_fleet_agent.urdf.xml import MAX_CHARACTERS, XmlError, XmlReader

_log = logging.getLogger(__name__)

_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
    (b"<\x00?\x00", "utf-16-le"),
    (b"\x00<\x00?", "utf-16-be"),
)
_DECLARED: Final = re.compile(rb"\s*<\?xml[^>]{0,100}?encoding\s*=\s*[\"']([A-Za-z0-9._-]{1,40})[\"']")
_EXPRESSION: Final = re.compile(r"\$[{(][^})]{0,60}[})]?")
_READ: Final = ("link", "joint", "material")


class UrdfError(ValueError):
    """A text that does not describe one robot. The message is a sentence for people: it says what is wrong, and
    where.
    """


def decode(content: bytes, source: str = "the description") -> str:
    """Return the text of a file in the encoding of its byte order mark or declaration, otherwise UTF-8.

    A file that is none of these is read as Latin-1, with a warning that names ``source``. Raises UrdfError.
    """
    encoding = next((name for mark, name in _MARKS if content.startswith(mark)), None)
    declared = _DECLARED.match(content)
    encoding = encoding or (declared[1].decode() if declared else "utf-8")
    try:
        return content.decode(encoding)
    except LookupError:
        raise UrdfError(f"the XML declaration names the encoding {encoding!r}, which is unknown") from None
    except UnicodeDecodeError as error:
        if declared or encoding != "utf-8":
            raise UrdfError(f"the file is no text in its encoding {encoding}: {error.reason}") from error
        line = content.count(b"\n", 0, error.start) + 1
        _log.warning("%s: line %d is not UTF-8 and no encoding is declared; it is read as Latin-1", source, line)
        return content.decode("latin-1")


def parse(text: str) -> Element:
    """Return the ``robot`` element of a description. Raises UrdfError, with the line for XML that is not well-formed.

    Document types are refused, so that no entity expands.
    """
    if len(text) > MAX_CHARACTERS:
        raise UrdfError(f"the description has {len(text)} characters; at most {MAX_CHARACTERS} are read")
    try:
        root, reader = _read(text)
    except XmlError as error:
        raise UrdfError(str(error)) from error
    if root.tag != "robot":
        raise UrdfError(f"the root element is <{root.tag[:40]}>, not <robot>")
    xacro = {prefix for prefix, iri in reader.namespaces.items() if iri.rstrip("/").endswith("xacro")}
    _refuse_xacro(root, {"xacro", *xacro})
    _drop_foreign(root)
    return root


def _read(text: str) -> tuple[Element, XmlReader]:
    reader = XmlReader("URDF")
    try:
        return reader.read(text), reader
    except expat.ExpatError:
        # Two hyphens in a comment are common, and well-formed to the readers of ROS.
        reader = XmlReader("URDF")
        return reader.read_or_refuse(_without_comments(text)), reader


def _without_comments(text: str) -> str:
    """Return the text with the line ends of comments alone. A comment that does not end stays, and is searched once."""
    parts, at = list[str](), 0
    while (begin := text.find("<!--", at)) >= 0 and (end := text.find("-->", begin + 4)) >= 0:
        parts += text[at:begin], "\n" * text.count("\n", begin, end)
        at = end + 3
    return "".join((*parts, text[at:]))


def _refuse_xacro(root: Element, prefixes: set[str]) -> None:
    """Raise UrdfError for elements and expressions of xacro, with the joint or link that contains them."""
    for holder in (root, *root):
        where = f"{holder.tag} {holder.get('name', '')[:128]!r}" if holder.tag in ("link", "joint") else "the robot"
        for element in (holder,) if holder is root else holder.iter():
            _refuse_xacro_at(element, where, prefixes, holder is root or holder.tag in _READ)


def _refuse_xacro_at(element: Element, where: str, prefixes: set[str], is_read: bool) -> None:
    advice = "this is a xacro file and no URDF yet; write it with `xacro FILE.xacro > FILE.urdf`"
    if element.tag.partition(":")[0] in prefixes and ":" in element.tag:
        raise UrdfError(f"{where} contains the element <{element.tag[:60]}>: {advice}")
    for name, value in element.attrib.items() if is_read else ():
        found = _EXPRESSION.search(value)
        if found:
            raise UrdfError(f"{where} contains the expression {found[0]!r} ({name} of <{element.tag}>): {advice}")


def _drop_foreign(root: Element) -> None:
    for element in root.iter():
        if any(":" in name or name == "xmlns" for name in element.attrib):
            kept = {name: value for name, value in element.attrib.items() if ":" not in name and name != "xmlns"}
            element.attrib.clear()
            element.attrib.update(kept)
        if any(":" in child.tag for child in element):
            element[:] = [child for child in element if ":" not in child.tag]
