"""Questions and answers of the process that simplifies meshes."""

from msgspec import Struct

MAX_TRIANGLES = 4_000
"""Triangles of a simplified mesh: enough for a robot on a phone, or among others."""


class Simplify(Struct, frozen=True):
    """The ``content`` of a mesh file, whose format ``suffix`` says."""

    suffix: str
    content: bytes


class Simplified(Struct, frozen=True, tag=True):
    """The mesh as binary glTF, in metre, with about ``MAX_TRIANGLES`` triangles and its own colours, if it has any."""

    content: bytes


class SimplifyFailed(Struct, frozen=True, tag=True):
    """The reason why the mesh cannot be simplified."""

    reason: str


SimplifyAnswer = Simplified | SimplifyFailed
