"""A cache of compiled renderings of measured values, by resource, media type and base URL."""

from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.template import Rendering

MAX_KEPT = 4096


class Renderings:
    """Bounded, oldest dropped first. A rendering is compiled again when the facts of its resource change."""

    def __init__(self, most: int = MAX_KEPT) -> None:
        self._most = most
        self._kept: dict[tuple[str, str, str], tuple[object, Rendering]] = {}

    def of(self, resource: Resource, media_type: str, base: str) -> Rendering:
        """Return the rendering of a resource for which ``compiles`` is true."""
        key, facts = (base, resource.path, media_type), resource.source.facts()
        kept = self._kept.get(key)
        if kept is None or kept[0] != facts:
            self._kept.pop(key, None)
            while len(self._kept) >= self._most:
                del self._kept[next(iter(self._kept))]
            kept = self._kept[key] = (facts, Rendering(resource, media_type, base))
        return kept[1]

    def __len__(self) -> int:
        return len(self._kept)
