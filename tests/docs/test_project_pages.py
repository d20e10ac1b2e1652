"""The project's own pages: their links work, and what they say about versions is true."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

from linked_fleet_agent.wire.messages import COMPONENTS_VERSION
from running import ROOT

_PAGES = ("CONTRIBUTING.md", ".github/CODE_OF_CONDUCT.md", ".github/SECURITY.md", "deploy/helm/README.md")


@pytest.mark.parametrize("name", _PAGES)
def test_links_lead_somewhere(name: str) -> None:
    page = ROOT / name
    targets = re.findall(r"\]\((?!https?:)([^)#]+)(?:#[^)]*)?\)", page.read_text())
    assert [target for target in targets if not (page.parent / target).exists()] == []


def test_make_has_the_commands_that_contributors_are_told() -> None:
    rules = (ROOT / "Makefile").read_text()
    told = re.findall(r"`make ([\w-]+)`", (ROOT / "CONTRIBUTING.md").read_text())
    assert len(told) >= 4
    assert [name for name in told if not re.search(rf"^{name}:", rules, re.M)] == []


def test_files_that_contributors_are_told_exist() -> None:
    told = re.findall(r"`((?:tests|gateway)/[\w/.]+)`", (ROOT / "CONTRIBUTING.md").read_text())
    assert len(told) >= 4
    assert [name for name in told if not (ROOT / name).exists()] == []


def test_the_version_of_the_wire_is_that_of_the_code() -> None:
    assert f"| wire, between agents and gateways | {COMPONENTS_VERSION} |" in (ROOT / "CONTRIBUTING.md").read_text()


def test_the_citation_names_the_paper_and_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    paper = citation["preferred-citation"]
    assert [author["family-names"] for author in paper["authors"]] == [
        "Schubotz", "Vogelgesang", "Antakli", "Rubinstein", "Spieldenner",
    ]  # fmt: skip
    assert "doi" not in paper, "its DOI is not known"


@pytest.mark.parametrize("path", sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.md")), ids=lambda path: path.name)
def test_forms_of_issues_have_what_their_site_reads(path: Path) -> None:
    _, head, body = path.read_text().split("---\n", 2)
    assert {"name", "about", "labels"} <= yaml.safe_load(head).keys()
    assert body.strip()


def test_the_namespace_of_the_vocabulary_leads_to_where_gateways_have_it() -> None:
    rules = (ROOT / "deploy" / "w3id" / ".htaccess").read_text()
    (pattern, target) = re.findall(r"^RewriteRule (\S+) https://fleet\.example(\S+) \[R=303,L\]$", rules, re.M)[0]
    assert re.match(pattern, "") and target == "/vocabulary"


@pytest.mark.parametrize("folder", ["", "agents"])
def test_links_of_the_packages_follow_a_redirect(folder: str) -> None:
    links = tomllib.loads((ROOT / folder / "pyproject.toml").read_text())["project"]["urls"]
    rules = re.findall(r"^RewriteRule (\S+) ", (ROOT / "deploy" / "w3id" / ".htaccess").read_text(), re.M)
    assert len(links) == 3
    for link in links.values():
        path = link.removeprefix("https://w3id.org/linked-fleet").removeprefix("/")
        kind = path.partition("/")[0]
        assert next(rule for rule in rules if re.match(rule, path)).startswith(f"^{kind}"), link


def test_a_release_says_which_addresses_its_publisher_has_to_fill_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "deploy"))
    import release  # type: ignore[import-not-found]

    text = (ROOT / "deploy" / "w3id" / ".htaccess").read_text()
    filled_in = tmp_path / "deploy" / "w3id" / ".htaccess"
    filled_in.parent.mkdir(parents=True)
    monkeypatch.setattr(release, "ROOT", tmp_path)
    monkeypatch.setattr(release, "_REDIRECTS", filled_in)
    monkeypatch.setattr(release, "_run", lambda *words: "")
    filled_in.write_text(text)
    repository, server = release.publication_obstacles()
    assert "code.example" in repository and "fleet.example" in server
    filled_in.write_text(text.replace("https://code.example/", "https://git.test/x/"))
    (left,) = release.publication_obstacles()
    assert left == server
    filled_in.write_text(filled_in.read_text().replace("https://fleet.example/", "https://fleet.test/"))
    assert list(release.publication_obstacles()) == []


def test_each_step_of_the_tutorial_has_a_picture() -> None:
    parts = re.split(r"^## ", (ROOT / "docs" / "TUTORIAL.md").read_text(), flags=re.M)
    steps = [part for part in parts if part[0].isdigit()]
    assert len(steps) >= 6
    for step in steps:
        pictures = re.findall(r"!\[.+\]\((\S+)\)", step)
        assert pictures and all((ROOT / "docs" / each).is_file() for each in pictures), step.splitlines()[0]
