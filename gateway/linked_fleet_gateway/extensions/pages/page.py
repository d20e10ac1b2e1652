"""Resources as HTML: the triples of their description in readable form; scripts only add live updates.

The Content Security Policy (Level 3) of pages allows only this gateway's scripts and connections.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit, urlunsplit

from markupsafe import Markup
from pyoxigraph import Triple

from linked_fleet_base.errors import FleetError
from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.extensions.pages import languages, templating, texts
from linked_fleet_gateway.extensions.pages.assets import assets
from linked_fleet_gateway.extensions.pages.help import help_of
from linked_fleet_gateway.extensions.pages.texts import clean
from linked_fleet_gateway.extensions.pages.view import view_of
from linked_fleet_gateway.extensions.pages.views import added_views, places
from linked_fleet_gateway.faces import PageContext, Reader, Resource
from linked_fleet_rdf import jsonld
from linked_fleet_rdf.vocabulary import PREFIXES

if TYPE_CHECKING:
    import jinja2
else:
    jinja2 = LazyModule("jinja2")


_TEMPLATES = Path(__file__).parent / "templates"


def write(
    resource: Resource,
    triples: Sequence[Triple],
    base: str,
    context: PageContext,
    formats: Mapping[str, tuple[str, str]],
) -> bytes:
    """Return the page of a resource; ``base`` is scheme and authority. Equal triples give equal bytes."""
    with languages.speaking(context.reader.languages):
        view = view_of(resource, triples, base, formats, context)
        data = script_json(jsonld.write_jsonld(triples, PREFIXES))
        return render(f"{view.kind}.html", view=view, data=data, places=view.places, reader=context.reader)


def write_problem(
    error: FleetError, instance: str | None, report: Sequence[Mapping[str, str]], reader: Reader | None
) -> bytes:
    """Return the page of an error. It has a Stop button if its address and its reader are known."""
    address = urlsplit(instance) if instance and reader else None
    root = f"{address.scheme}://{address.netloc}/" if address else ""
    with languages.speaking(reader.languages if reader else ""):
        return render(
            "problem.html",
            error=error,
            detail=texts.readable_title(error.detail, root) if root else error.detail,
            instance=instance,
            here=address and urlunsplit(("", "", *address[2:])),
            root=root,
            places=places(address.path if address else None, reader.restricted_paths if reader else ()),
            reader=reader,
            members={name: value for name, value in error.members.items() if value},
            report=report,
        )


def render(template: str, **variables: object) -> bytes:
    """Render a template with the variables that all pages need, in the language that is spoken."""
    folders = tuple(dict.fromkeys(each.template.parent for each in added_views()))
    common = {"entries": assets().entries, "places": places(), "language": languages.language()}
    common |= {"languages": languages.NAMES}
    return _templates(folders).get_template(template).render(common | variables).encode()


def check_template(file: Path) -> None:
    """Raise OSError or jinja2.TemplateError for a template that cannot be used."""
    _templates(()).parse(file.read_text(encoding="utf-8"), filename=str(file))


def script_json(json: str) -> Markup:
    """Escape JSON for a script element, which ends at the first ``</script`` whatever is around it."""
    escaped = json.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    return Markup(escaped)  # noqa: S704 - contains nothing that HTML could read as markup


@cache
def _templates(folders: tuple[Path, ...]) -> "jinja2.Environment":
    """Return the environment of templates; ``folders`` are template folders of other extensions."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([_TEMPLATES, *folders]),
        autoescape=True,
        auto_reload=False,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        extensions=[templating.extension()],
    )
    environment.filters["clean"] = clean
    environment.globals |= {"_": languages.say, "_said": languages.said_in_template, "_known": languages.known}
    environment.globals |= {"help_of": help_of, "choice_of_language": languages.address_of_choice}
    return environment


POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",  # textures inside meshes become object URLs
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)

FORMS = POLICY.replace("form-action 'none'", "form-action 'self'")
"""The policy of pages with a form that works without scripts: those for logging in and out."""
