"""The choice of a language: a link that sets a cookie and leads back to its page, so that it works without scripts."""

from dataclasses import dataclass
from urllib.parse import quote

from linked_fleet_gateway.api import FleetBranch, NotFound, Request, RequestView, Resource, Response
from linked_fleet_gateway.extensions.pages.languages import COOKIE, MARKED, NAMES, SEGMENT
from linked_fleet_rdf.vocabulary import LDP

_YEAR_S = 365 * 86400
_LONGEST_PATH = 2000


@dataclass(frozen=True)
class ChooseLanguage:
    """Get pages in a language from now on."""

    language: str


def _choice(view: RequestView, rest: list[str]) -> Resource | None:
    if len(rest) != 1 or rest[0] not in (*NAMES, MARKED):
        return None
    return Resource(f"/{SEGMENT}/{rest[0]}", "Language", None, (LDP.Resource,), remote=ChooseLanguage(rest[0]))


async def choose(request: Request, resource: Resource, chosen: ChooseLanguage) -> Response:
    """Set the cookie, and lead back to a page of this gateway. Raises NotFound for an address of another one."""
    then = request.query_params.get("then", "/")
    if not then.startswith("/") or then.startswith(("//", "/\\")) or len(then) > _LONGEST_PATH:
        raise NotFound("?then= is the path of a page of this gateway, such as /world.")
    location = request.base + quote(then, safe="/~?&=%.,:;@!$'()*+-_")
    response = Response(status_code=303, headers={"location": location, "cache-control": "no-store"})
    response.set_cookie(
        COOKIE, chosen.language, _YEAR_S, path="/", secure=request.base.startswith("https:"), samesite="lax"
    )
    return response


CHOICES = FleetBranch(SEGMENT, None, _choice)
