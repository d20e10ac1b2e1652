"""The extension ``pages``: resources and problems as HTML, with forms generated from their shapes."""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from pyoxigraph import Triple

from linked_fleet_gateway.base.errors import FleetError
from linked_fleet_gateway.extensions.pages import page
from linked_fleet_gateway.extensions.pages.assets import BRANCH, THUMBNAIL, THUMBNAILS
from linked_fleet_gateway.extensions.pages.page import FORMS, POLICY
from linked_fleet_gateway.extensions.pages.views import add_view, checked_view, set_entries
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.html import NOBODY, Formats, PageContext, Reader
from linked_fleet_gateway.resources.resource import Resource


class Pages:
    """Implements ``linked_fleet_gateway.http.html.HtmlWriter``."""

    modules: Sequence[str] = ("jinja2", "linked_fleet_client.quantity", "linked_fleet_gateway.extensions.pages.form")

    def prepare(self) -> None:
        """Compile the templates of problems, which alone are written on the event loop."""
        self.write_problem(FleetError("a page that nobody sees"), "http://localhost/", [], NOBODY)

    def write_resource(
        self, resource: Resource, triples: Sequence[Triple], base: str, formats: Formats, context: PageContext
    ) -> bytes:
        return page.write(resource, triples, base, context, formats)

    def write_problem(
        self, error: FleetError, instance: str | None, report: Sequence[Mapping[str, str]], reader: Reader | None
    ) -> bytes:
        return page.write_problem(error, instance, report, reader)

    def content_security_policy(self, forms: bool) -> str:
        return FORMS if forms else POLICY


_BUILT_IN = Path(__file__).parents[1]


class PagesExtension(Extension):
    name = "pages"
    at_root = ("assets",)
    in_robot = (THUMBNAIL,)
    public = ("assets",)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        for extension in core.extensions:
            with core.live.faults.guard("pages", thing=f"views of {extension.name}"):
                for view in extension.views():
                    checked = checked_view(view)
                    if not checked.template.is_relative_to(_BUILT_IN):  # the tests check the others
                        page.check_template(checked.template)
                    add_view(checked)
        set_entries(core.navigation)
        yield Mount(branches=(BRANCH, THUMBNAILS), html=Pages())
