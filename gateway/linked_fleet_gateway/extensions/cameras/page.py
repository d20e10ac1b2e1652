"""The page of a camera."""

from pathlib import Path

from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.cameras.resources import LF
from linked_fleet_gateway.extensions.pages.thing_views import AROUND, PRESENCE, presence
from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.extensions.pages.views import PageView, Part


def camera(facts: Facts, iri: NamedNode) -> Part:
    """Show the picture, which has the URL of the camera, or the reason for having none."""
    there = facts.one(iri, LF.picture) == iri
    more = {
        "presence": presence(facts, iri),
        "picture": iri.value if there else "",
        "width": facts.text(iri, LF.imageWidth),
        "height": facts.text(iri, LF.imageHeight),
        "reason": facts.text(iri, LF.reason),
    }
    return Part(more, {*PRESENCE, *AROUND, *((LF.picture,) if there else ())})


VIEW = PageView(LF.Camera, Path(__file__).parent / "templates" / "camera.html", camera)
