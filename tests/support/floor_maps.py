"""Maps of a floor as ROS ``map_server`` has them, and their upload as ``curl -F`` sends it."""

from collections.abc import Sequence

import httpx

FREE, WALL, UNKNOWN = 254, 0, 205
"""Shades of ``map_saver``."""


def pgm(rows: Sequence[Sequence[int]]) -> bytes:
    """Return an image, the topmost row first."""
    return b"P5\n# a floor\n%d %d\n255\n" % (len(rows[0]), len(rows)) + bytes(value for row in rows for value in row)


def yaml(
    resolution: float = 0.1, origin: tuple[float, float, float] = (0.0, 0.0, 0.0), image: str = "floor.pgm"
) -> bytes:
    return (
        f"image: {image}\nresolution: {resolution}\norigin: {list(origin)}\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    ).encode()


def upload(
    http: httpx.Client, url: str, image: bytes, settings: bytes | None = None, *, name: str = "floor.pgm", **more: str
) -> httpx.Response:
    """PUT a map; ``more`` are header fields, or the fields ``height`` and ``title`` of the form."""
    files = {"yaml": ("floor.yaml", yaml() if settings is None else settings), "image": (name, image)}
    form = {key: more.pop(key) for key in ("height", "title") if key in more}
    return http.put(url, files=files, data=form, headers={key.replace("_", "-"): value for key, value in more.items()})
