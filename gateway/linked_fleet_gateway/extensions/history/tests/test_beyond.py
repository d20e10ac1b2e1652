"""Histories over HTTP that reach beyond memory: they are the same from disk, also after a restart."""

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from mcap.reader import make_reader

from browser import LF, ROS, SOSA, Browser
from running import eventually
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
JOINT = "elbow_joint"


@dataclass
class Known:
    browser: Browser
    whole: str
    rotation: str
    before: list[dict[str, str]]
    """The samples in the memory of the gateway that has ended."""
    state: Path

    def rows(self, url: str, **query: str) -> list[dict[str, str]]:
        answer = self.browser.http.get(url, params=query, headers={"accept": "text/csv"})
        assert answer.status_code == 200, answer.text
        return list(csv.DictReader(io.StringIO(answer.text, newline="")))


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Known]:
    """A gateway that has begun anew, with a robot that was heard by the one before."""
    place = Place(tmp_path_factory.mktemp("state"))
    with place.ur5("--sway", f"ur5:{JOINT}"):
        with place.gateway() as (_, browser):
            live(browser, "ur5")
            whole = str(browser.robot("ur5").one(LF.history))
            found = Known(browser, whole, "", [], place.state)
            eventually(lambda: len(found.rows(whole)) > 80, "some seconds of history")
            before = found.rows(whole)
        with place.gateway() as (_, browser):
            live(browser, "ur5")
            rotation = browser.part("ur5", JOINT).one(ROS.rotation)
            known = Known(browser, whole, "", before, place.state)
            eventually(lambda: len(known.rows(whole)) > 30, "some seconds of another history")
            known.rotation = str(browser.page(whole).graph.value(rotation, LF.history))
            yield known
            eventually(lambda: browser.http.get(whole).status_code == 200, "it answers")


def test_samples_from_disk_are_those_that_memory_had(known: Known) -> None:
    end = known.before[-1]["time"]
    from_disk = known.rows(known.whole, **{"from": known.before[0]["time"], "to": end})
    memory = {row["time"]: row for row in known.before}
    assert len(from_disk) > 10
    assert all(memory[row["time"]] == row for row in from_disk)
    assert from_disk[0] == known.before[0]


def test_a_span_goes_from_disk_into_memory_without_a_sample_twice_and_says_the_gap_between(known: Known) -> None:
    rows = known.rows(known.whole, **{"from": known.before[0]["time"]})
    times = [row["time"] for row in rows]
    assert times == sorted(set(times))
    recent = known.rows(known.whole)
    assert recent[0]["time"] in times
    (gap,) = [row for row in rows if not any(value for name, value in row.items() if name != "time")]
    assert known.before[-1]["time"] <= gap["time"] < recent[0]["time"]


def test_a_property_has_the_same_samples(known: Known) -> None:
    query = {"from": known.before[0]["time"], "to": known.before[-1]["time"]}
    rows = known.rows(known.rotation, **query)
    whole = known.rows(known.whole, **query)
    name = f"{JOINT}/rotation (rad)"
    assert [(row["time"], row["rotation (rad)"]) for row in rows] == [(row["time"], row[name]) for row in whole]
    page = known.browser.page(known.rotation + "?from=" + query["from"] + "&to=" + query["to"])
    assert len(set(page.graph.subjects(SOSA.resultTime))) == len(rows)


def test_the_value_at_an_instant_is_the_last_one_before(known: Known) -> None:
    at = known.before[40]["time"]
    (row,) = known.rows(known.whole, at=at)
    assert row["time"] <= at and row in known.before
    later = known.rows(known.whole)[-1]["time"]
    (now,) = known.rows(known.whole, at=later)
    assert now["time"] == later
    (observed,) = known.browser.page(f"{known.rotation}?at={at}").graph.objects(None, SOSA.hasSimpleResult)
    assert float(str(observed)) == pytest.approx(float(row[f"{JOINT}/rotation (rad)"]), rel=1e-6)


def test_when_nothing_was_heard_there_is_no_value(known: Known) -> None:
    last = datetime.fromisoformat(known.before[0]["time"]) - timedelta(seconds=30)
    assert known.rows(known.whole, at=last.isoformat()) == []
    assert known.rows(known.whole, at="2100-01-01T00:00:00Z") == []


def test_pages_back_lead_to_what_is_on_disk(known: Known) -> None:
    recent = known.rows(known.whole)
    rows = known.rows(known.whole, to=recent[0]["time"], limit="15")
    assert len(rows) == 15 and rows[-1]["time"] < recent[0]["time"]
    assert rows[0] in known.before


def test_a_file_for_foxglove_has_what_was_then(known: Known) -> None:
    query = {"from": known.before[0]["time"], "to": known.before[-1]["time"], "as": "mcap"}
    answer = known.browser.http.get(known.whole, params=query)
    messages = [channel.topic for _, channel, _ in make_reader(io.BytesIO(answer.content)).iter_messages()]
    assert messages.count("/joint_states") == len(known.rows(known.whole, **{"from": query["from"], "to": query["to"]}))


def test_the_description_says_what_is_on_disk(known: Known) -> None:
    page = known.browser.page(known.whole)
    oldest = datetime.fromisoformat(str(page.one(LF.oldestSample)))
    assert abs(oldest - datetime.fromisoformat(known.before[0]["time"])) < timedelta(milliseconds=2)
    assert (page.iri, LF.diskSpan, None) in page.graph
    text = known.browser.http.get(known.browser.root + "metrics").text
    numbers = dict(line.split() for line in text.splitlines() if line.startswith("linked_fleet_history_disk"))
    assert float(numbers["linked_fleet_history_disk_segments"]) == 2
    assert float(numbers["linked_fleet_history_disk_lost_total"]) == 0


@pytest.mark.parametrize("query", ["at=x", "at=2026-01-01T00:00:00Z&limit=3", "at=2026-01-01T00:00:00Z&last=PT1S"])
def test_an_instant_that_is_none_is_refused(known: Known, query: str) -> None:
    answer = known.browser.http.get(f"{known.whole}?{query}")
    assert answer.status_code == 400 and "at is" in answer.text
