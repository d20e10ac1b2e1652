"""Messages of rclpy as JSON by their type: values that differ by field, their bytes, and the hash of the type.

It runs in an environment of its own (``make ros-peers``).
"""

import importlib
import json
import re
import sys
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message

TYPES = Path(__file__).with_name("message_types.txt").read_text().split()
_MOST_ITEMS = 2
_ARRAY = re.compile(r"(?P<of>[^\[]+)\[(?P<size>\d+)\]")
_SEQUENCE = re.compile(r"sequence<(?P<of>.+?)(, (?P<most>\d+))?>")
_TEXT = re.compile(r"string(<\d+>)?")
_SIZES = {"boolean": 1, "octet": 1, "float": 4, "double": 8} | {
    f"{sign}int{bits}": bits // 8 for sign in ("", "u") for bits in (8, 16, 32, 64)
}


def class_of(name: str) -> Any:
    """Return the class of a message, also of a part of a service or action."""
    package, kind, type_ = name.split("/")
    module = importlib.import_module(f"{package}.{kind}")
    if hasattr(module, type_):
        return getattr(module, type_)
    base, *parts = type_.split("_")
    found = getattr(module, base)
    if kind == "action" and parts[0] in ("SendGoal", "GetResult", "FeedbackMessage"):
        inner = parts[0] + ("Service" if parts[0] != "FeedbackMessage" else "")
        found, parts = getattr(found.Impl, inner), parts[1:]
    for part in parts:
        found = getattr(found, part)
    return found


class Layout:
    """Where the fields of a message are in its bytes. The bytes between them have any values, and are set to zero."""

    def __init__(self) -> None:
        self._end, self._filled, self._count = 0, [], 0

    def number(self) -> int:
        """Return the next value."""
        self._count = self._count % 100 + 1
        return self._count

    def add(self, size: int, align: int = 0) -> None:
        """Append a field of so many bytes, aligned as its type is."""
        begin = self._end + -self._end % (align or size)
        self._filled += [False] * (begin - self._end) + [True] * size
        self._end = begin + size

    def skip(self) -> None:
        """Append the byte that stands in a message without fields."""
        self._filled.append(False)
        self._end += 1

    def clean(self, cdr: bytes) -> bytes:
        """Return the bytes of the message, which has a head of four bytes."""
        body = cdr[4:]
        filled = self._filled + [False] * (len(body) - self._end)
        return cdr[:4] + bytes(byte if used else 0 for byte, used in zip(body, filled, strict=True))


def filled(message: Any, layout: Layout) -> Any:
    """Return the message with a value in each field, and these values."""
    values = {}
    for name, type_ in message.get_fields_and_field_types().items():
        value, values[name] = _value(type_, getattr(message, name), layout)
        setattr(message, name, value)
    if not values:
        layout.skip()
    return message, values


def _value(type_: str, present: Any, layout: Layout) -> tuple[Any, Any]:
    if array := _ARRAY.fullmatch(type_):
        return _items(array["of"], int(array["size"]), layout)
    if sequence := _SEQUENCE.fullmatch(type_):
        layout.add(4)
        return _items(sequence["of"], min(int(sequence["most"] or _MOST_ITEMS), _MOST_ITEMS), layout)
    if "/" in type_:
        package, name = type_.split("/")
        return filled(type(present)() if present is not None else class_of(f"{package}/msg/{name}")(), layout)
    number = layout.number()
    if _TEXT.fullmatch(type_):
        layout.add(4)
        layout.add(len(f"µ{number}".encode()) + 1, align=1)
        return f"µ{number}", f"µ{number}"
    layout.add(_SIZES[type_])
    if type_ in ("float", "double"):
        return number + 0.5, number + 0.5
    if type_ == "boolean":
        return bool(number % 2), bool(number % 2)
    return bytes([number]) if type_ == "octet" else number, number


def _items(of: str, size: int, layout: Layout) -> tuple[Any, Any]:
    both = [_value(of, None, layout) for _ in range(size)]
    return [value for value, _ in both], [said for _, said in both]


def hash_of(node: Node, name: str, type_: Any) -> str:
    """Return the hash that a publisher of the type states; empty for parts of services and actions, which have none."""
    if "/msg/" not in name:
        return ""
    topic = name.rpartition("/")[2]
    publisher = node.create_publisher(type_, topic, 1)
    (info,) = node.get_publishers_info_by_topic(topic)
    node.destroy_publisher(publisher)
    return str(info.topic_type_hash)


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("messages")
    said = {}
    for name in TYPES:
        type_ = class_of(name)
        layout = Layout()
        message, values = filled(type_(), layout)
        cdr = layout.clean(serialize_message(message)).hex()
        said[name] = {"hash": hash_of(node, name, type_), "cdr": cdr, "value": values}
    json.dump(said, sys.stdout)


if __name__ == "__main__":
    main()
