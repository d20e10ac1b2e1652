"""Content codings: gzip if accepted, entity tags of their own, and conditional writes with either of them."""

import re

import httpx
import pytest

from browser import Browser
from linked_fleet_gateway.http.negotiation import accepts_gzip, preferred_coding

_JOINT = "baxter/right_s1"


@pytest.mark.parametrize(
    ("field", "takes"),
    [
        (b"gzip, deflate, br, zstd", True), (b"br, GZIP;q=0.5", True), (b"*", True), (b"x-gzip", True),
        (b"gzip;q=0", False), (b"identity", False), (b"gzip;q=0.2, identity", False), (b"", False),
        (b"gzip;q=x", False), (b"*;q=0", False),
    ],
)  # fmt: skip
def test_accept_encoding_is_parsed(field: bytes, takes: bool) -> None:
    assert accepts_gzip(field) is takes


@pytest.mark.parametrize(
    ("field", "coding"),
    [
        (b"gzip, deflate, br, zstd", "br"), (b"gzip", "gzip"), (b"br;q=0.5, gzip", "gzip"), (b"*", "br"),
        (b"br;q=0, *", "gzip"), (b"identity, br;q=0.5", ""), (b"deflate", ""), (b"", ""),
    ],
)  # fmt: skip
def test_the_coding_that_is_preferred(field: bytes, coding: str) -> None:
    assert preferred_coding(field, ("br", "gzip")) == coding


@pytest.mark.parametrize("coding", ["br", "gzip"])
def test_scripts_are_kept_in_codings(browser: Browser, coding: str) -> None:
    page = browser.http.get(browser.root, headers={"accept": "text/html"}).text
    (path,) = re.findall(r"/(assets/page-\w+\.js)", page)
    plain, coded = (_raw(browser, path, each) for each in ("identity", coding))
    assert "content-encoding" not in plain.headers
    assert (coded.headers["content-encoding"], coded.headers["vary"]) == (coding, plain.headers["vary"])
    assert int(coded.headers["content-length"]) < int(plain.headers["content-length"]) / 2
    assert coded.headers["etag"] == plain.headers["etag"][:-1] + f'-{coding}"'
    for sent, status in ((coding, 304), ("identity", 200)):
        headers = {"accept-encoding": sent, "if-none-match": coded.headers["etag"]}
        assert browser.http.head(browser.root + path, headers=headers).status_code == status


def _raw(browser: Browser, path: str, coding: str) -> httpx.Response:
    """Return only the header fields: the client cannot decode each coding."""
    return browser.http.head(browser.root + path, headers={"accept": "*/*", "accept-encoding": coding})


def _get(browser: Browser, path: str, coding: str, **fields: str) -> httpx.Response:
    headers = {"accept": "text/turtle", "accept-encoding": coding, **fields}
    return browser.http.get(browser.root + path, headers=headers)


@pytest.mark.parametrize("path", [f"{_JOINT}/blueprint", "vocabulary"])
def test_the_content_is_the_same_and_the_tag_another(browser: Browser, path: str) -> None:
    """The first time, and from the cache."""
    for _ in range(2):
        plain, coded = _get(browser, path, "identity"), _get(browser, path, "gzip")
        assert "content-encoding" not in plain.headers
        assert coded.headers["content-encoding"] == "gzip"
        assert int(coded.headers["content-length"]) < len(plain.content) / 2
        assert coded.content == plain.content
        assert coded.headers["etag"] == plain.headers["etag"][:-1] + '-gzip"'
        assert "Accept-Encoding" in plain.headers["vary"] and plain.headers["vary"] == coded.headers["vary"]


@pytest.mark.parametrize("path", [f"{_JOINT}/blueprint", "vocabulary", "baxter/linkset"])
@pytest.mark.parametrize("coding", ["identity", "gzip"])
@pytest.mark.parametrize("has", ["identity", "gzip"])
def test_the_tag_of_another_coding_is_that_of_another_representation(
    browser: Browser, path: str, coding: str, has: str
) -> None:
    """RFC 9110, 13.1.2: a cache that joined them would send bytes in the wrong coding. Also from our own cache."""
    known = {"accept": "*/*"} if path.endswith("linkset") else {}
    for weak in ("", "W/"):
        tag = _get(browser, path, has, **known).headers["etag"]
        again = _get(browser, path, coding, **known, **{"if-none-match": f'"x", {weak}{tag.removeprefix("W/")}'})
        assert again.status_code == (304 if has == coding else 200)
        assert again.headers["etag"] == _get(browser, path, coding, **known).headers["etag"]


def test_a_write_may_name_the_tag_of_a_coding(browser: Browser) -> None:
    """A client that reads in gzip is protected against lost updates like any other."""
    path = "baxter/annotations"
    url = browser.root + path
    tag = browser.http.get(url, headers={"accept": "text/turtle", "accept-encoding": "identity"}).headers["etag"]
    coded = tag[:-1] + '-gzip"'
    fields = {"content-type": "text/turtle", "if-match": coded}
    body = f"<{browser.root}baxter/> <http://purl.org/dc/terms/subject> 'coded' ."
    assert browser.http.put(url, content=body, headers=fields).status_code == 204
    assert browser.http.put(url, content=body + " ", headers={**fields, "if-match": '"x-gzip"'}).status_code == 412


def test_values_and_short_contents_are_sent_as_they_are(browser: Browser) -> None:
    assert "content-encoding" not in _get(browser, f"{_JOINT}/rotation", "gzip").headers


def test_long_contents_with_values_are_coded_too(browser: Browser) -> None:
    for _ in range(2):
        coded = _get(browser, _JOINT, "gzip")
        assert coded.headers["content-encoding"] == "gzip" and coded.headers["etag"].endswith('-gzip"')
        assert len(coded.content) > 2 * int(coded.headers["content-length"])
        assert "content-encoding" not in _get(browser, _JOINT, "identity").headers
