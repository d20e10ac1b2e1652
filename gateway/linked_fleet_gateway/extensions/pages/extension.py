"""The extension ``pages``: resources and problems as HTML, with forms generated from their shapes."""

import inspect
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from pyoxigraph import Triple

from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.api import Core, Extension, Mount, Resource
from linked_fleet_gateway.extensions.pages import page
from linked_fleet_gateway.extensions.pages.assets import THUMBNAIL
from linked_fleet_gateway.extensions.pages.branches import ASSETS, THUMBNAILS
from linked_fleet_gateway.extensions.pages.language_choice import CHOICES, ChooseLanguage, choose
from linked_fleet_gateway.extensions.pages.languages import SEGMENT, add_folder, chosen_language
from linked_fleet_gateway.extensions.pages.page import FORMS, POLICY
from linked_fleet_gateway.extensions.pages.views import add_view, checked_view, set_entries
from linked_fleet_gateway.faces import PageContext, Reader


class Pages:
    """Implements ``linked_fleet_gateway.resources.html.HtmlWriter``."""

    modules: Sequence[str] = ("jinja2", "linked_fleet_client.quantity", "linked_fleet_gateway.extensions.pages.form")

    def prepare(self) -> None:
        """Compile the templates of problems, which alone are written on the event loop."""
        self.write_problem(FleetError("a page that nobody sees"), "http://localhost/", [], Reader())

    def write_resource(
        self,
        resource: Resource,
        triples: Sequence[Triple],
        base: str,
        formats: Mapping[str, tuple[str, str]],
        context: PageContext,
    ) -> bytes:
        return page.write(resource, triples, base, context, formats)

    def write_problem(
        self, error: FleetError, instance: str | None, report: Sequence[Mapping[str, str]], reader: Reader | None
    ) -> bytes:
        return page.write_problem(error, instance, report, reader)

    def language(self, reader: Reader) -> str:
        return chosen_language(reader.languages)

    def content_security_policy(self, forms: bool) -> str:
        return FORMS if forms else POLICY


_BUILT_IN = Path(__file__).parents[1]


class PagesExtension(Extension):
    name = "pages"
    at_root = ("assets", SEGMENT)
    in_robot = (THUMBNAIL,)
    public = ("assets", SEGMENT)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        for extension in core.extensions:
            with core.faults.guard("pages", thing=f"languages of {extension.name}"):
                add_folder(Path(inspect.getfile(type(extension))).parent / "languages")
            with core.faults.guard("pages", thing=f"views of {extension.name}"):
                for view in extension.views():
                    checked = checked_view(view)
                    if not checked.template.is_relative_to(_BUILT_IN):  # the tests check the others
                        page.check_template(checked.template)
                    add_view(checked)
        set_entries(core.navigation)
        yield Mount(branches=(ASSETS, THUMBNAILS, CHOICES), readers={ChooseLanguage: choose}, html=Pages())
