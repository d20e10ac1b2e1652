"""A page of another origin that may use the fleet, in a real browser."""

import contextlib
import http.server
import threading
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page

from authenticated_gateway import ALL, SEEN, run_authenticated
from browser import LF

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


class _Twin(http.server.BaseHTTPRequestHandler):
    """A site with one page, on which the test runs scripts."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>Twin</title><link rel=icon href=data:,>")

    def log_message(self, *_: object) -> None:
        pass


@contextlib.contextmanager
def _site() -> Iterator[str]:
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Twin) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_a_page_of_another_origin_reads_and_acts_with_its_token(
    page: Page, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Preflight requests are answered, and response fields can be read."""
    with _site() as twin, run_authenticated(tmp_path_factory.mktemp("cors"), "--cors-origins", twin) as fleet:
        fleet.add("all", *ALL)
        fleet.known("all")
        with fleet.browsing("root") as browser:
            stop_all = browser.action(browser.page(browser.root), LF.StopAll)
        page.goto(twin)
        found = page.evaluate(
            """async ([root, stop, token]) => {
              const headers = {Authorization: "Bearer " + token, Accept: "application/ld+json"};
              const read = await fetch(root, {headers}), text = await read.text();
              const done = await fetch(stop, {method: "POST", headers});
              return [read.status, read.headers.get("etag"), text, done.status, done.headers.get("location")];
            }""",
            [fleet.root, stop_all, fleet.tokens["all"]],
        )
    status, etag, text, done, location = found
    assert (status, done) == (200, 204)
    assert etag.startswith('"') and SEEN in text and location.startswith(fleet.root)
