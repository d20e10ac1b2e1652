"""YAML files of maps, as ROS ``map_server`` reads and writes them. Pure.

It reads the seven keys of such a file, in the forms in which its programs write them, and no other YAML: a line with a
key and a number or a name, and the origin as a list in brackets or with a dash for each number.
"""

import re
from collections.abc import Iterator
from typing import Any, get_args

from linked_fleet_gateway.extensions.world.floor_map import (
    MAX_YAML_BYTES,
    MapSettings,
    Mode,
    UnusableMap,
    check_settings,
)

KEYS = ("image", "mode", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
_REQUIRED = tuple(key for key in KEYS if key != "mode")
_PAIR = re.compile(r"(\w+)[ ]*:(?:[ ]+(.*))?")
_ITEM = re.compile(r"[ ]*-[ ]+(.+)")
_NUMBER = re.compile(r"[-+]?(?:\d{1,20}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][-+]?\d{1,3})?")
_QUOTED = re.compile(r"\"([^\"\\]*)\"|'([^']*)'")
_PLAIN = re.compile(r"[^\s\"'\[\]{},&*!|>%@`#-][^\[\]{}\"'&*|>`#]*")
_FLAGS = {"0": False, "false": False, "no": False, "1": True, "true": True, "yes": True}


def read_yaml(content: bytes) -> tuple[MapSettings, str]:
    """Return the settings in a YAML file, and the name of its image. Raises UnusableMap with a sentence."""
    if len(content) > MAX_YAML_BYTES:
        raise UnusableMap(f"The YAML has {len(content)} bytes; that of a map has at most {MAX_YAML_BYTES}.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnusableMap("The YAML is no text in UTF-8.") from error
    found = _pairs(text)
    if missing := [key for key in _REQUIRED if key not in found]:
        raise UnusableMap(f"The YAML has no {missing[0]}; a map has {', '.join(_REQUIRED)}, and may have mode.")
    settings = MapSettings(
        resolution=_number(found["resolution"], "resolution"),
        origin=_origin(found["origin"]),
        negate=_choice(found["negate"], "negate", _FLAGS),
        occupied_thresh=_number(found["occupied_thresh"], "occupied_thresh"),
        free_thresh=_number(found["free_thresh"], "free_thresh"),
        mode=_choice(found.get("mode", "trinary"), "mode", {each: each for each in get_args(Mode)}),
    )
    check_settings(settings)
    return settings, _name(found["image"])


def write_yaml(settings: MapSettings, image: str) -> bytes:
    """Return the YAML file of a map whose image is in a file beside it."""
    x, y, yaw = settings.origin
    values = (
        image, settings.mode, repr(settings.resolution), f"[{x!r}, {y!r}, {yaw!r}]", int(settings.negate),
        repr(settings.occupied_thresh), repr(settings.free_thresh),
    )  # fmt: skip
    return "".join(f"{key}: {value}\n" for key, value in zip(KEYS, values, strict=True)).encode()


def _pairs(text: str) -> dict[str, str]:
    """Return the values by key, as they are written; items of a list are joined in brackets."""
    found: dict[str, str] = {}
    lines = _Lines(text)
    for number, line in lines:
        pair = _PAIR.fullmatch(line)
        if pair is None:
            raise UnusableMap(f"Line {number} of the YAML is no key with a value of a map: {line.strip()[:60]!r}.")
        key, value = pair[1], (pair[2] or "").strip()
        if key not in KEYS:
            raise UnusableMap(
                f"Line {number} of the YAML has the key {key[:30]!r}; those of a map are {', '.join(KEYS)}."
            )
        if key in found:
            raise UnusableMap(f"Line {number} of the YAML says {key} again.")
        found[key] = value
        if key == "origin":
            found[key] = _whole_list(value, lines)
    return found


class _Lines:
    """The lines of a text that say something, without comments, and their numbers."""

    def __init__(self, text: str) -> None:
        self._lines = [(i, _bare(line)) for i, line in enumerate(text.splitlines(), 1)]
        self._lines = [(i, line) for i, line in self._lines if line.strip() and line.strip() not in ("---", "...")]

    def __iter__(self) -> Iterator[tuple[int, str]]:
        while self._lines:
            yield self._lines.pop(0)

    def items(self) -> Iterator[str]:
        """Take the items of a list off that begin the next lines."""
        while self._lines and (item := _ITEM.fullmatch(self._lines[0][1])) is not None:
            self._lines.pop(0)
            yield item[1].strip()

    def until_bracket(self) -> Iterator[str]:
        """Take lines off up to the one that ends with a bracket."""
        while self._lines:
            _, line = self._lines.pop(0)
            yield line.strip()
            if line.rstrip().endswith("]"):
                return


def _bare(line: str) -> str:
    """Return a line without its comment, which begins the line or follows a space."""
    return re.sub(r"(?:^|\s)#.*$", "", line).rstrip()


def _whole_list(value: str, lines: _Lines) -> str:
    if not value:
        return f"[{', '.join(lines.items())}]"
    return value if value.endswith("]") else " ".join((value, *lines.until_bracket()))


def _origin(text: str) -> tuple[float, float, float]:
    numbers = text[1:-1].split(",") if text.startswith("[") and text.endswith("]") else []
    if len(numbers) != 3:
        raise UnusableMap(
            f"The origin in the YAML is a list of x, y and yaw, such as [-10.0, -10.0, 0.0], not {text[:60]!r}."
        )
    x, y, yaw = (_number(each.strip(), "origin") for each in numbers)
    return x, y, yaw


def _number(text: str, key: str) -> float:
    if _NUMBER.fullmatch(text) is None:
        raise UnusableMap(f"The {key} in the YAML is a number, not {text[:60]!r}.")
    return float(text)


def _choice(text: str, key: str, values: dict[str, Any]) -> Any:
    found = _unquoted(text).lower()
    if found not in values:
        raise UnusableMap(f"The {key} in the YAML is one of {', '.join(values)}, not {text[:60]!r}.")
    return values[found]


def _name(text: str) -> str:
    found = _unquoted(text)
    if not found or (found == text and _PLAIN.fullmatch(text) is None):
        raise UnusableMap(f"The image in the YAML is the name of a file, not {text[:60]!r}.")
    return re.split(r"[/\\]", found)[-1]


def _unquoted(text: str) -> str:
    quoted = _QUOTED.fullmatch(text)
    return text if quoted is None else quoted[1] or quoted[2] or ""
