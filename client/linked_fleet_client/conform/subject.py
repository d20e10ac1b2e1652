"""The server under test: the resources found, and its cached answers."""

from dataclasses import dataclass, field

from linked_fleet_client.conform.trials import Trials
from linked_fleet_client.conform.walk import Page, Walk, read
from linked_fleet_client.conform.web import Answer, Web


@dataclass
class Subject:
    web: Web
    walk: Walk
    trials: Trials
    writes: bool
    _options: dict[str, Answer] = field(default_factory=dict)
    _read: dict[str, Page] = field(default_factory=dict)

    async def options(self, url: str) -> Answer:
        if url not in self._options:
            self._options[url] = await self.web.request("OPTIONS", url)
        return self._options[url]

    async def page(self, url: str) -> Page:
        """Return a page that a resource names, reading it if the walk did not reach it."""
        found = self.walk.pages.get(url) or self._read.get(url)
        if found is None:
            found = self._read[url] = await read(self.web, url)
        return found

    def answering(self) -> list[Page]:
        return [page for page in self.walk if page.answer.successful]

    def extent(self) -> str:
        """Return the extent of the check as text, for evidence."""
        return f"{len(self.walk)} resources from {self.walk.root.url}"
