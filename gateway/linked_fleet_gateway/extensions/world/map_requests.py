"""Requests to the map of the floor: the upload of a form, its removal, and GET of its image."""

import math
import re
from functools import partial
from typing import TYPE_CHECKING

from starlette.responses import Response

from linked_fleet_base.errors import NotAcceptable
from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.api import (
    BadRequest,
    Content,
    NotFound,
    Request,
    Resource,
    Table,
    UnprocessableContent,
    body_type,
    choose,
)
from linked_fleet_gateway.extensions.world.floor_map import (
    DEFAULT_HEIGHT_M,
    ID,
    LARGEST_HEIGHT_M,
    MAX_UPLOAD_BYTES,
    FloorMap,
    UnusableMap,
    pgm_of,
)
from linked_fleet_gateway.extensions.world.form_data import BadForm, Part, read_form
from linked_fleet_gateway.extensions.world.map_resources import FORM, MAP, PGM, PGM_FILE, MapImage, PutMap
from linked_fleet_gateway.extensions.world.map_yaml import read_yaml
from linked_fleet_gateway.serving import convert_body, resolve_under_preconditions

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.world import map_image
else:
    map_image = LazyModule(
        "linked_fleet_gateway.extensions.world.map_image", "numpy"
    )  # gateways without maps need none

_FIELDS = ("yaml", "image", "height", "title")
_LONGEST_TITLE = 256
_HEIGHT = re.compile(r"\d{1,4}(?:\.\d{1,6})?")
_HOW = f"curl -X PUT -F yaml=@floor.yaml -F image=@floor.pgm …{MAP}"


async def put_map(maps: Table[FloorMap], request: Request, afforded: PutMap) -> Response:
    """Replace or remove the map. The response is 204."""
    found = None if request.method == "DELETE" else await _uploaded(request)
    while True:
        # Evaluated in each attempt, because the map may change meanwhile, also at another gateway.
        if await resolve_under_preconditions(request, lambda: request.tree().resolve(MAP)) is None:
            raise NotFound("The world has no map any more.")
        is_there = found == maps.known.get(ID) and not maps.unreadable
        if is_there or await maps.change(ID, found):
            return Response(status_code=204)


async def _uploaded(request: Request) -> FloorMap:
    body_type(request, PutMap.body_types)
    read = partial(_read, content_type=request.field("content-type") or FORM, client=request.caller_name)
    return await convert_body(request, read, MAX_UPLOAD_BYTES, is_slow=True)


def _read(body: bytes, content_type: str, client: str) -> FloorMap:
    """Return the map in a form; called in a thread. Raises BadRequest, UnprocessableContent."""
    try:
        form = read_form(body, content_type, _FIELDS)
        if missing := [each for each in ("yaml", "image") if each not in form]:
            raise BadForm(f"The form has no {missing[0]}: send both files of the map, {_HOW}.")
    except BadForm as error:
        raise BadRequest(str(error)) from error
    try:
        settings, image = read_yaml(form["yaml"].content)
        _check_names(image, form["image"].file_name)
        title = _title(form.get("title"), image)
        height_m = _height(form.get("height"))
        return map_image.build_map(settings, form["image"].content, title=title, height_m=height_m, client=client)
    except UnusableMap as error:
        raise UnprocessableContent(str(error)) from error


def _check_names(said: str, sent: str) -> None:
    """Refuse the image of another map. A client that pipes its image sends no name, or that of standard input."""
    if sent not in ("", "-", said):
        raise UnusableMap(
            f"The YAML names the image {said[:60]!r}, and the file sent is {sent[:60]!r}; send that of the YAML."
        )


def _title(part: Part | None, image: str) -> str:
    text = image.rpartition(".")[0] or image if part is None else part.content.decode("utf-8", "replace").strip()
    if not 1 <= len(text) <= _LONGEST_TITLE or not text.isprintable():
        raise UnusableMap(f"The title of a map is a line of 1 to {_LONGEST_TITLE} characters.")
    return text


def _height(part: Part | None) -> float:
    if part is None:
        return DEFAULT_HEIGHT_M
    text = part.content[:100].decode("utf-8", "replace").strip()
    found = float(text) if _HEIGHT.fullmatch(text) is not None else math.nan
    if not 0 < found <= LARGEST_HEIGHT_M:
        raise UnusableMap(f"The height of obstacles is a number of metres, above 0 and at most {LARGEST_HEIGHT_M:g}.")
    return found


async def read_image(request: Request, resource: Resource, asked: MapImage) -> Response:
    """Answer GET of the image, which is unpacked in a thread if the client needs it. Raises NotAcceptable."""
    if choose(request.field("accept"), (PGM,)) is None:
        raise NotAcceptable(f"Available here: {PGM}.", offered=(PGM,))
    found, etag = asked.map, f'"{asked.map.sha256}"'
    headers = Content.headers(request, resource, PGM) | {"content-disposition": f'inline; filename="{PGM_FILE}"'}
    if (known := Content.known(request, headers | {"etag": etag})) is not None:
        return known
    body = await request.services.offload.run(partial(pgm_of, found), found.columns * found.rows)
    return Content(body, etag, found.image).response(request, headers)
