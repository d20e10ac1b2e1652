"""An operator teaches poses and runs a sequence of them, on a desktop and on a phone, in few clicks."""

import pytest
from playwright.sync_api import expect

from accessibility import violations_in_both_schemes
from browser import LDP
from browser import Browser as Client
from page_user import PageUser

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture(autouse=True)
def without_poses(client: Client) -> None:
    page = client.page(client.root + "ur5/poses")
    for each in page.graph.objects(page.iri, LDP.contains):
        client.http.delete(str(each))


@pytest.mark.task("Teach two poses and run them as a sequence", presses=9)
def test_poses_are_taught_and_run_as_a_sequence(operator: PageUser, client: Client) -> None:
    page, press = operator.page, operator.press
    page.goto(client.root + "ur5/")
    name, saved = page.get_by_label("Name of the present pose"), page.locator("#teach .answer")
    name.fill("above")
    press(page.get_by_role("button", name="Save this pose"))
    expect(saved).to_have_text("Saved: above")
    assert operator.made == 1

    elbow = page.get_by_label("target of elbow_joint in °")
    elbow.fill("40")
    press(page.get_by_role("button", name="Move", exact=True))
    expect(page.locator("#move .outcome")).to_contain_text("succeeded")
    name.fill("below")
    press(page.get_by_role("button", name="Save this pose"))
    expect(saved).to_have_text("Saved: below")
    expect(page.locator("#pose-buttons").get_by_role("button", name="below")).to_be_visible()
    assert operator.made == 3

    press(page.locator("#teach-title a"))
    for pose in ("below", "above"):
        press(page.get_by_label(f"{pose} as a step"))
    expect(page.locator("#sequence li")).to_have_text(["below", "above"])
    assert violations_in_both_schemes(page) == [] and operator.fits()
    press(page.get_by_role("button", name="Make a mission"))
    page.wait_for_url("**/missions/builder?mission=*")
    assert operator.made == 7
    press(page.get_by_text("Run the mission"))
    press(page.locator("#builder details.action form.invoke button").last)
    page.wait_for_url("**/mission-runs/*")
    assert operator.made == 9
    expect(page.locator("#run-state .state")).to_have_attribute("data-state", "succeeded")
    operator.finish()

    page.goto(client.root + "ur5/poses")
    press(page.get_by_role("link", name="below"))
    field = page.get_by_label("elbow_joint in °")
    expect(field).to_have_value("40")
    press(page.get_by_role("button", name="Try without moving"))
    expect(page.locator("#go .answer")).to_contain_text("It would work")
    field.fill("30")
    assert violations_in_both_schemes(page) == [] and operator.fits()
    press(page.get_by_role("button", name="Save", exact=True))
    expect(page.locator("#edit .answer")).to_have_text("Done.")
    expect(field).to_have_value("30")
    press(page.get_by_role("button", name="Go there"))
    expect(page.locator("#go .outcome")).to_contain_text("succeeded")
    press(page.get_by_role("button", name="Delete"))
    press(page.get_by_role("dialog").get_by_role("button", name="Delete"))
    page.wait_for_url("**/ur5/poses")
    expect(page.get_by_role("link", name="below")).to_have_count(0)
    assert operator.made == 15


@pytest.mark.task("Write a note for the next shift", presses=1)
def test_a_note_is_written_on_the_page_of_a_robot(operator: PageUser, client: Client) -> None:
    page, press = operator.page, operator.press
    page.goto(client.root + "ur5/")
    notes = page.locator("#notes")
    notes.scroll_into_view_if_needed()
    notes.get_by_role("textbox").fill("It squeaks.\nGreased on Monday.")
    press(notes.get_by_role("button", name="Write it down"))
    expect(notes.locator("li .text")).to_have_text("It squeaks.\nGreased on Monday.")
    operator.finish()
    press(notes.get_by_role("button", name="Delete"))
    press(page.get_by_role("dialog").get_by_role("button", name="Delete"))
    expect(notes.locator("li")).to_have_count(0)
    page.goto(client.root + "ur5/notes")
    expect(page.locator("#notes")).to_contain_text("Nobody has written a note")
    assert violations_in_both_schemes(page) == [] and operator.fits()
