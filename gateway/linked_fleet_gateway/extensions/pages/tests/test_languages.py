"""Pages speak the language of the reader: which one that is, and that every text is in a catalogue."""

import importlib.util
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType

import pytest
from pyoxigraph import Literal, RdfFormat, parse

from browser import LF, Browser
from dom import Element, parsed
from linked_fleet_gateway.extensions.pages.help import help_of
from linked_fleet_gateway.extensions.pages.languages import chosen_language, known, say, speaking
from linked_fleet_gateway.extensions.pages.templating import messages_of, with_calls
from linked_fleet_gateway.extensions.pages.views import added_views
from linked_fleet_rdf.vocabulary import RDFS
from outside_catalogue import MARKED, outside
from plain_words import texts
from running import ROOT

pytestmark = pytest.mark.virtual
GERMAN = {"accept": "text/html", "accept-language": "de-AT, en;q=0.5"}
ENGLISH = {"accept": "text/html", "accept-language": "en"}
PATHS = (
    *("", "?view=table", "ur5/", "ur5/elbow_joint", "ur5/elbow_joint/actions/rotate", "ur5/elbow_joint/rotation"),
    *("ur5/tool0", "ur5/lease", "ur5/jointState", "ur5/history", "ur5/subscriptions", "ur5/title", "faults", "world"),
    *("world/objects", "world/map", "world/collisions", "missions", "missions/builder", "mission-runs", "queue"),
    *("schedules", "rules", "timeline", "cameras", "history", "things", "audit", "people", "query", "vocabulary"),
    *("nothing", "login", "ur5/elbow_joint/actions/rotate/invocations", "query?query=ASK%7B%3Fa%20%3Fb%20%3Fc%7D"),
)
"""A page of each kind that a demo has without being used."""
JARGON = re.compile(
    r"produces?hape|dry run true|iri template|told apart by|\bscopes?\b|blueprint|SHACL|\bIRI\b", re.IGNORECASE
)
CAMEL = re.compile(r"\b[a-z]+(?:[A-Z][a-z0-9]*)+\b")


@pytest.fixture(scope="module")
def script() -> ModuleType:
    found = importlib.util.spec_from_file_location("messages", ROOT / "docs" / "messages.py")
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def read(browser: Browser, path: str, fields: Mapping[str, str]) -> Element:
    return parsed(browser.http.get(browser.root + path, headers=dict(fields)).content)


# -- which language -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("preferred", "chosen"),
    [
        ("", "en"), ("de", "de"), ("de-CH, fr;q=0.9", "de"), ("fr, de;q=0.2, en;q=0.8", "en"), ("fr", "en"),
        ("de;q=0, en;q=0.1", "en"), ("DE-at;q=1.000", "de"), ("*", "en"), ("de;q=7", "en"), (",;=,q", "en"),
        ("en-XA", "en-XA"), ("en-GB", "en"), ("x" * 9000, "en"), ("fr," * 40 + "de", "en"),
    ],
)  # fmt: skip
def test_the_language_is_the_best_that_there_is(preferred: str, chosen: str) -> None:
    assert chosen_language(preferred) == chosen


def test_a_page_says_its_language_and_what_it_depends_on(browser: Browser) -> None:
    german, english = (browser.http.get(browser.root, headers=each) for each in (GERMAN, ENGLISH))
    assert (german.headers["content-language"], english.headers["content-language"]) == ("de", "en")
    assert {"Accept-Language", "Cookie"} <= set(german.headers["vary"].split(", "))
    assert german.headers["etag"] != english.headers["etag"]
    known_already = GERMAN | {"if-none-match": german.headers["etag"]}
    assert browser.http.get(browser.root + "world", headers=GERMAN).text.count('<html lang="de">') == 1
    assert (
        browser.http.get(browser.root, headers=ENGLISH | {"if-none-match": german.headers["etag"]}).status_code == 200
    )
    assert browser.http.get(browser.root + "vocabulary", headers=known_already).headers["content-language"] == "de"


def test_data_are_the_same_in_every_language(browser: Browser) -> None:
    german, english = (
        browser.http.get(browser.root + "ur5/", headers={"accept": "text/turtle", "accept-language": each})
        for each in ("de", "en")
    )
    assert "content-language" not in german.headers
    assert sorted(german.text.splitlines())[:9] == sorted(english.text.splitlines())[:9]


@pytest.mark.parametrize("path", ["world", "?view=table", "nothing", "query?query=ASK+%7B%3Fa+%3Fb+%3Fc%7D"])
def test_a_link_chooses_the_language_and_leads_back(browser: Browser, path: str) -> None:
    page = read(browser, path, ENGLISH)
    (link,) = [each for each in page.all("a") if each.get("hreflang") == "de"]
    assert link.text == "Deutsch" and link["lang"] == "de"
    answer = browser.http.get(browser.root.rstrip("/") + link["href"], follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, browser.root + path)
    browser.http.cookies.clear()  # other tests choose their own
    assert re.match(r"language=de; Max-Age=\d+; Path=/; SameSite=lax", answer.headers["set-cookie"])
    chosen = browser.http.get(browser.root, headers=ENGLISH | {"cookie": "language=de"})
    assert chosen.headers["content-language"] == "de"


@pytest.mark.parametrize(
    "then", ["//elsewhere.example/", "https://elsewhere.example/", "/\\elsewhere.example", "/" * 2001]
)
def test_the_link_leads_to_no_other_site(browser: Browser, then: str) -> None:
    answer = browser.http.get(browser.root + "~language/de", params={"then": then}, follow_redirects=False)
    assert answer.status_code == 404 and "set-cookie" not in answer.headers


# -- every text is in a catalogue -----------------------------------------------------------------------------------


@pytest.mark.parametrize("path", PATHS)
def test_no_text_is_outside_the_catalogue(browser: Browser, path: str) -> None:
    assert outside(read(browser, path, MARKED)) == []


def test_every_message_has_a_german_text_with_the_same_values(script: ModuleType) -> None:
    shared = script.catalogue(script.EXTENSIONS / "pages", "de")
    for folder, said in script.all_messages().items():
        own = shared | script.catalogue(folder, "de")
        assert {each for each in said if not own.get(each)} == set(), f"{folder.name}: docs/messages.py names them"
    for path in script.EXTENSIONS.glob("*/languages/*.json"):
        for message, text in script.catalogue(path.parents[1], path.stem).items():
            assert slots(message) == slots(text), (path, message)


def slots(text: str) -> set[str]:
    return set(re.findall(r"\{(\w+)\}", text))


def test_no_extension_says_again_what_the_pages_say(script: ModuleType) -> None:
    shared = script.catalogue(script.EXTENSIONS / "pages", "de")
    for path in script.EXTENSIONS.glob("*/languages/de.json"):
        if path.parents[1].name != "pages":
            assert shared.keys().isdisjoint(script.catalogue(path.parents[1], "de")), path


def vocabularies(script: ModuleType) -> list[Path]:
    return [script.SHAPES / "vocabulary.ttl", *script.EXTENSIONS.glob("*/vocabulary.ttl")]


def test_every_term_of_the_vocabulary_has_a_german_label(script: ModuleType) -> None:
    for path in vocabularies(script):
        text = path.read_text()
        assert len(re.findall(r'rdfs:label "', text)) == len(re.findall(r'rdfs:label "[^"]*" , "[^"]+"@de', text)), path


def test_every_term_of_the_vocabulary_has_a_german_comment(script: ModuleType) -> None:
    """It is a sentence that names the same terms as the English one, which has no language."""
    comments: dict[object, dict[str | None, str]] = {}
    for path in vocabularies(script):
        for each in parse(path.read_bytes(), format=RdfFormat.TURTLE):
            if each.predicate == RDFS.label:
                comments.setdefault(each.subject, {})
            elif each.predicate == RDFS.comment and isinstance(each.object, Literal):
                comments.setdefault(each.subject, {})[each.object.language] = each.object.value
    assert len(comments) > 600
    for term, said in comments.items():
        assert said.keys() == {None, "de"}, term
        assert said["de"].endswith(".") and said["de"] != said[None], term
        assert named_terms(said["de"]) == named_terms(said[None]), term


def named_terms(text: str) -> set[str]:
    return set(re.findall(r"\b[a-z]+:[A-Za-z]\w*", text))


def test_terms_are_explained_in_the_language_of_the_page(browser: Browser) -> None:
    """In the vocabulary, and by the tooltips of other pages."""
    page = read(browser, "vocabulary", GERMAN)
    assert [each.text for each in page.by_id("offline").all("td")][-1] == (
        "Der Agent ist nicht verbunden, siehe zuletzt gesehen."
    )
    assert "eine Station, die es lädt (Ladestationen)" in page.by_id("Dock").text
    assert [each.text for each in page.all("h1")] == ["Begriffe und Formen von Linked Fleet"]
    german, english = (tooltips(read(browser, "ur5/elbow_joint", each)) for each in (GERMAN, ENGLISH))
    assert english.keys() == german.keys() and len(german) > 5
    assert {term for term, said in german.items() if said == english[term] or "://" in said} == set()


def tooltips(page: Element) -> dict[str, str]:
    """Return the titles of links to terms by the addresses of the terms."""
    links = [each for each in page.all("a") if "/vocabulary#" in each.get("href") and "title" in each.attributes]
    return {each["href"]: each["title"] for each in links}


# -- messages in templates ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("template", "messages"),
    [
        ("<p>Two words</p>", {"Two words"}),
        ("<p>Rows {{ a }} to\n {{ b|length }}.</p>", {"Rows {1} to {2}."}),
        ('<a title="Go {{ where }}" href="/x y">{{ name }}</a>', {"Go {1}"}),
        ("<p>{% if a > b %}More{% else %}Less{% endif %}</p>", {"More", "Less"}),
        ("<code>SELECT ?a</code><script>let a = 1;</script><!-- a comment -->{# another #}", set()),
        ('{{ log(_("When"), [_("What it is")]) }} {{ "data" }}', {"When", "What it is"}),
        ("<td>{{ a }} · {{ b }}</td><i>&mdash; 5 %</i>", set()),
        ("<p>Save &amp; go</p>", {"Save & go"}),
        ('{% macro at(a) %} data-path="{{ a }}"{% endmacro %}', set()),
        ('<input{% if a %} placeholder="Any word"{% endif %} value="as it is">', {"Any word"}),
    ],
)
def test_texts_of_templates_are_messages(template: str, messages: set[str]) -> None:
    assert messages_of(template) == messages


def test_a_template_keeps_its_lines_for_error_messages() -> None:
    template = "<p>One\ntwo {{ a }}\nthree</p>\n{% if a %}\n<b>four\n</b>{% endif %}\n"
    assert with_calls(template).count("\n") == template.count("\n")


def test_a_translation_is_escaped_and_has_its_values() -> None:
    with speaking("en-XA"):
        assert say("{count} open faults", count=3) == "⟦3 open faults⟧"
        assert known("a title that nobody translates") == "a title that nobody translates"
    with speaking("de"):
        assert say("{part} of {whole}", part="a", whole="{part}") == "a von {part}"
    assert say("{part} of {whole}", part="a", whole="b") == "a of b"


# -- words and help -------------------------------------------------------------------------------------------------


def visible(element: Element) -> Iterator[str]:
    """Yield texts that people read without opening what is for developers, and that are no data."""
    for each in element.children:
        if isinstance(each, Element) and each.get("id") != "developers" and each.tag not in ("bdi", "noscript", "head"):
            yield from visible(each) if each.tag not in ("code", "script", "style", "pre", "textarea") else ()
        elif isinstance(each, str) and each.strip():
            yield each.strip()


@pytest.mark.parametrize("fields", [ENGLISH, GERMAN], ids=["English", "German"])
@pytest.mark.parametrize("path", [each for each in PATHS if not each.startswith(("vocabulary", "query"))])
def test_operators_read_no_jargon(browser: Browser, path: str, fields: Mapping[str, str]) -> None:
    found = [text for text in visible(read(browser, path, fields)) if JARGON.search(text) or CAMEL.search(text)]
    assert found == []


@pytest.mark.parametrize("path", PATHS)
def test_every_page_has_help_that_needs_no_scripts(browser: Browser, path: str) -> None:
    page = read(browser, path, ENGLISH)
    found = [each for each in page.all("details") if each.get("class") == "help"]
    if path == "login" and not found:
        return  # without authentication there is no such page
    (own,) = found
    (summary,) = own.all("summary")
    assert (summary.text, summary["aria-label"]) == ("?", "Help")
    assert len(next(own.all("p")).text) > 20
    (guide,) = own.all("a")
    assert guide["href"].startswith("https://w3id.org/linked-fleet/source/HEAD/")


def test_every_kind_of_page_has_help(browser: Browser) -> None:
    assert browser.http.get(browser.root).status_code == 200
    templates = (ROOT / "gateway/linked_fleet_gateway/extensions").glob("*/templates/*.html")
    kinds = {each.stem for each in templates if 'extends "frame.html"' in each.read_text()}
    with_help = set(re.findall(r'"(\w+)[.]html"(?:,[^,()]*)*?,\s*(?:constants=[^,]*,\s*)?help=', _pages()))
    own = {each for each in kinds if help_of(each)}
    assert kinds - with_help - own - {"with_presence"} == set()
    assert {"German": help_in("de", "fleet")} != {"German": help_in("en", "fleet")}
    assert all(isinstance(each.help, str) for each in added_views())


def help_in(language: str, kind: str) -> str:
    with speaking(language):
        found = help_of(kind)
    assert found is not None
    return found.text


def _pages() -> str:
    return "".join(each.read_text() for each in ROOT.glob("gateway/linked_fleet_gateway/extensions/*/page.py"))


def test_a_guide_leads_to_a_page_that_there_is() -> None:
    sources = [*ROOT.glob("gateway/linked_fleet_gateway/extensions/*/page.py")]
    sources.append(ROOT / "gateway/linked_fleet_gateway/extensions/pages/help.py")
    named = {found for each in sources for found in re.findall(r'"((?:docs|shapes)/[\w/]+[.]md)"', each.read_text())}
    assert len(named) > 5
    assert {each for each in named if not (ROOT / each).is_file()} == set()


def test_breadcrumbs_are_names(browser: Browser) -> None:
    robot = browser.robot("ur5")
    page = read(browser, "ur5/elbow_joint", ENGLISH)
    (nav,) = [each for each in page.all("nav") if each.get("class") == "crumbs"]
    names = [each.text for each in nav.all("li")]
    title = str(next(robot.graph.objects(robot.iri, LF.term("title")), "")) or names[1]
    assert names == ["Fleet", title, "elbow_joint"] and title != "ur5"


def test_all_words_are_read(browser: Browser) -> None:
    """The German pages have German words: a whole page is no English left over."""
    english = set(texts(read(browser, "", ENGLISH)))
    german = set(texts(read(browser, "", GERMAN)))
    assert {"Flotte", "Störungen", "Für Entwickler"} <= german and "For developers" in english
