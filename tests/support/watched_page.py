"""The console and the requests of a page, for tests of pages."""

from urllib.parse import urlsplit

from playwright.sync_api import ConsoleMessage, Page, Request


class Watched:
    """Console messages and requests of a page."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._said: list[str] = []
        self._asked: set[str] = set()
        page.on("console", self._console)
        page.on("pageerror", lambda error: self._said.append(str(error)))
        page.on("request", self._request)

    def _console(self, message: ConsoleMessage) -> None:
        # A page that is left while connecting is not at fault.
        if message.type in ("error", "warning") and "closed before the connection is established" not in message.text:
            self._said.append(f"{message.text} ({message.location.get('url')})")

    def _request(self, request: Request) -> None:
        self._asked.add(request.url)

    def forgive(self, *texts: str) -> None:
        """Accept console messages of the browser about failed requests that the test caused."""
        self._said = [each for each in self._said if not any(text in each for text in texts)]

    def check(self) -> None:
        assert not self._said, self._said
        home = urlsplit(self._page.url).netloc
        foreign = [each for each in self._asked if urlsplit(each).scheme in ("http", "https", "ws", "wss")]
        assert {urlsplit(each).netloc for each in foreign} <= {home}, foreign
