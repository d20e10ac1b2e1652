"""The queue on its page: orders are put elsewhere by dragging a row and by keys, and it says why each waits."""

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from accessibility import violations_in_both_schemes
from browser import LDP, LF
from browser import Browser as Client
from running import eventually

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
TITLES = ["first", "second", "third"]


def state(client: Client, order: str) -> str:
    told: dict[str, Any] = client.http.get(order, headers={"accept": "application/json"}).json()
    return str(told["state"])


@pytest.fixture
def queue(page: Page, watched: object, client: Client) -> Iterator[Page]:
    """Yield the page of the queue with one order that runs, and three that wait for its robot."""
    root, http = client.root, client.http
    turn = {"type": "invoke", "action": f"{root}ur5/wrist_3_joint/actions/hold"}
    steps = {"type": "sequence", "steps": [{"type": "wait", "seconds": 600}, turn]}
    mission = http.post(root + "missions", json={"title": "wait", "step": steps}).headers["location"]
    container = str(client.page(root).one(LF.queue))
    posted = [
        http.post(container, json={"mission": mission, "title": title}).headers["location"]
        for title in ("running", *TITLES)
    ]
    eventually(lambda: state(client, posted[0]) == "running", "the first order")
    page.goto(container)
    yield page
    page.goto(root)
    for order in posted[::-1]:
        http.post(f"{order}/actions/withdraw")
        eventually(lambda order=order: state(client, order) == "cancelled", "the end")  # type: ignore[misc]
    for order in client.page(container).graph.objects(None, LDP.contains):
        assert http.delete(str(order)).status_code == 204


def titles(page: Page) -> list[str]:
    return [
        each.split("\n")[0].strip()
        for each in page.locator("#waiting-orders tbody tr td:first-child").all_inner_texts()
    ]


def shows(page: Page, *wanted: str) -> None:
    eventually(lambda: titles(page) == list(wanted), lambda: str(titles(page)))


def test_the_page_shows_the_orders_in_their_turn_and_why_they_wait(queue: Page) -> None:
    shows(queue, *TITLES)
    expect(queue.locator("#running-orders tbody tr")).to_contain_text("running")
    expect(queue.locator("#waiting-orders tbody tr").first).to_contain_text("ur5, which has another order")
    assert not violations_in_both_schemes(queue)


def test_orders_are_moved_by_keys_and_the_focus_stays(queue: Page) -> None:
    shows(queue, *TITLES)
    button = queue.get_by_role("button", name="Move third up")
    button.focus()
    queue.keyboard.press("Enter")
    shows(queue, "first", "third", "second")
    expect(queue.get_by_role("button", name="Move third up")).to_be_focused()
    queue.keyboard.press("Enter")
    shows(queue, "third", "first", "second")
    queue.get_by_role("button", name="Move third down").click()
    shows(queue, "first", "third", "second")


def drag(page: Page, title: str, to: str, *, before: bool) -> None:
    """Drag the row of an order onto the upper or the lower half of another one, at the cells that say why they wait."""
    cells = page.locator("#waiting-orders tbody tr td:nth-child(2)")
    found = [cells.nth(titles(page).index(each)).bounding_box() for each in (title, to)]
    source, target = (each for each in found if each is not None)
    page.mouse.move(source["x"] + source["width"] / 2, source["y"] + source["height"] / 2)
    page.mouse.down()
    height = target["height"] * (0.2 if before else 0.8)
    page.mouse.move(target["x"] + target["width"] / 2, target["y"] + height, steps=8)
    page.mouse.up()


def test_orders_are_moved_by_dragging_their_rows(queue: Page) -> None:
    shows(queue, *TITLES)
    queue.locator("#waiting-orders").scroll_into_view_if_needed()
    drag(queue, "third", "first", before=True)
    shows(queue, "third", "first", "second")
    drag(queue, "third", "second", before=False)
    shows(queue, "first", "second", "third")
