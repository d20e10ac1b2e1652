"""A mission is built, checked, rehearsed, saved and run on pages, on a desktop and on a phone."""

import re

import pytest
from playwright.sync_api import Locator, Page, expect

from accessibility import violations_in_both_schemes
from browser import LDP, LF
from browser import Browser as Client
from page_user import PageUser
from running import eventually

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
JSON = {"accept": "application/json"}


def add(operator: PageUser, kind: str) -> None:
    operator.press(operator.page.get_by_role("button", name=kind, exact=True))


def fill(page: Page, label: str, text: str) -> None:
    page.get_by_label(label, exact=True).fill(text)
    page.get_by_label(label, exact=True).press("Tab")


def outline(page: Page) -> list[str]:
    """Return the kinds of the steps in their order, each after as many dots as it is deep."""
    found: list[str] = page.locator(".outline li").evaluate_all(
        "all => all.map((each) => '.'.repeat(function up(item) {"
        " const above = item.parentElement.closest('.outline li'); return above ? 1 + up(above) : 0; }(each))"
        " + each.querySelector('.kind').textContent)"
    )
    return found


def shows(page: Page, *steps: str) -> None:
    eventually(lambda: outline(page) == ["One after the other", *steps], lambda: str(outline(page)))


def begun(operator: PageUser, client: Client, title: str, parameter: str) -> tuple[Page, Locator]:
    """Begin a mission with a parameter; return its page, and the place of answers."""
    page = operator.page
    page.goto(client.root + "missions")
    operator.press(page.get_by_role("link", name="New mission"))
    fill(page, "Title of the mission", title)
    operator.press(page.get_by_role("button", name="Add a parameter"))
    fill(page, "Name of value1", parameter)
    return page, page.locator("#builder .builder-head .answer")


@pytest.mark.task("Build a mission of four steps, rehearse it and run it", presses=13)
def test_a_mission_is_built_and_run(operator: PageUser, client: Client) -> None:
    page, answer = begun(operator, client, "Nod", parameter="angle")
    for label, text in (("Least", "5"), ("Greatest", "500"), ("Default", "10")):
        page.get_by_label(f"{label} of").fill(text)
    page.get_by_label("Default of").press("Tab")

    add(operator, "Do an action")
    page.get_by_label("Robot", exact=True).select_option(f"{client.root}ur5/")
    page.get_by_label("Action", exact=True).select_option(label="rotate wrist_3_joint")
    expect(page.locator(".action-form form.invoke .range").first).to_contain_text("°")
    page.get_by_label("Where value comes from").first.select_option("angle")
    add(operator, "Ask a person")
    fill(page, "Question", "Is the way free?")
    add(operator, "Wait")
    fill(page, "Seconds", "-1")
    add(operator, "Tell people")
    fill(page, "Message", "It has nodded.")

    operator.press(page.get_by_role("button", name="Check"))
    expect(answer).to_have_attribute("data-state", "error")
    expect(page.locator(".step-row[data-wrong]")).to_contain_text("a number >= 0")
    expect(page.get_by_label("Seconds", exact=True)).to_have_attribute("aria-invalid", "true")
    fill(page, "Seconds", "0.1")
    operator.press(page.get_by_role("button", name="Check"))
    expect(page.locator(".step-row[data-wrong]")).to_have_count(0)
    expect(answer).to_have_text("No errors were found.")
    operator.press(page.get_by_role("button", name="Rehearse"))
    expect(answer).to_contain_text("1 of 1 actions are rehearsed")
    expect(page.locator(".step-row .note")).to_contain_text(" s")
    assert violations_in_both_schemes(page) == []
    operator.press(page.get_by_role("button", name="Save", exact=True))
    expect(answer).to_have_text("Saved.")
    assert operator.fits()

    operator.press(page.get_by_text("Run the mission"))
    operator.press(page.locator("#builder details.action form.invoke button", has_text=re.compile("^run$")))
    page.wait_for_url("**/mission-runs/*")
    operator.press(page.locator("#run-state").get_by_role("button", name="Yes: Is the way free?"))
    expect(page.locator("#run-state .state")).to_have_attribute("data-state", "succeeded")
    expect(page.locator("#run-state")).to_contain_text("It has nodded.")
    expect(page.locator(".run-steps li:has(.times)")).to_have_count(4)
    expect(page.locator(".run-steps .times").first).to_contain_text(re.compile(r"\d s"))
    operator.forgive("422")


def test_a_step_acts_on_the_robot_that_a_parameter_names(operator: PageUser, client: Client) -> None:
    """By its kind: whoever runs the mission says which robot it is."""
    page, answer = begun(operator, client, "Whoever", parameter="who")
    page.get_by_label("Type of").select_option("thing")
    add(operator, "Do an action")
    page.get_by_label("Robot", exact=True).select_option(label="what who names")
    page.get_by_label("Action", exact=True).select_option(label="rotate")
    value = page.locator('.action-form [data-member="value"]').first
    value.fill("1000")
    value.press("Tab")
    operator.press(page.get_by_role("button", name="Save", exact=True))
    expect(answer).to_have_text("Saved.")
    listed = client.page(client.root + "missions")
    kept = [client.http.get(str(each), headers=JSON).json() for each in listed.graph.objects(listed.iri, LDP.contains)]
    step = next(each["step"]["steps"][0] for each in kept if each["title"] == "Whoever")
    assert (step["kind"], step["of"]) == (f"{LF}Rotate", {"variable": "who"}) and "action" not in step
    assert step["body"]["value"] == 1000, "limits of one robot are not those of another"
    page.reload()
    operator.press(page.locator("button.step", has_text="Do an action"))
    expect(page.get_by_label("Robot", exact=True).locator("option:checked")).to_have_text("what who names")
    expect(page.get_by_label("Action", exact=True).locator("option:checked")).to_have_text("rotate")
    expect(value).to_have_value("1000")


def test_steps_are_moved_copied_and_deleted_and_the_mission_is_edited(operator: PageUser, client: Client) -> None:
    page = operator.page
    steps = [{"type": "notify", "text": "a"}, {"type": "repeat", "times": 2, "step": {"type": "confirm", "text": "b"}}]
    said = {"title": "moves", "step": {"type": "sequence", "steps": steps}}
    mission = client.http.post(client.root + "missions", json=said).headers["location"]
    page.goto(mission)
    operator.press(page.get_by_role("link", name="Edit"))
    expect(page.locator("#builder button.step")).to_have_count(4)
    shows(page, ".Tell people", ".Repeat", "..Ask a person")
    tell = page.locator("button.step", has_text="Tell people")
    tell.focus()
    page.keyboard.press("Alt+ArrowDown")
    shows(page, ".Repeat", "..Ask a person", ".Tell people")
    expect(tell).to_be_focused()
    page.keyboard.press("Alt+ArrowRight")
    shows(page, ".Repeat", "..One after the other", "...Ask a person", "...Tell people")
    operator.press(page.get_by_role("button", name="Move the step out"))
    shows(page, ".Repeat", "..One after the other", "...Ask a person", ".Tell people")
    operator.press(page.get_by_role("button", name="Duplicate"))
    page.keyboard.press("Delete")
    shows(page, ".Repeat", "..One after the other", "...Ask a person", ".Tell people")
    operator.press(page.get_by_role("button", name="Undo"))
    shows(page, ".Repeat", "..One after the other", "...Ask a person", ".Tell people", ".Tell people")
    drag(operator, page)
    shows(page, ".Tell people", ".Repeat", "..One after the other", "...Ask a person", ".Tell people")

    changed = {**said, "title": "changed elsewhere"}
    assert client.http.put(mission, json=changed).status_code == 204
    page.get_by_role("button", name="Save", exact=True).click()  # Chromium drops a tap right after an emulated drag
    page.get_by_role("button", name="Load it as it is now").click()
    expect(page.get_by_label("Title of the mission")).to_have_value("changed elsewhere")
    fill(page, "Title of the mission", "mine")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.locator("#builder .builder-head .answer")).to_have_text("Saved.")
    kept = client.http.get(mission, headers={"accept": "application/json"}).json()
    assert (kept["title"], kept["step"]) == ("mine", said["step"])
    page.goto(mission)
    operator.press(page.get_by_role("link", name="Put into the queue"))
    expect(page.locator("#new-order").get_by_label("mission")).to_have_value(mission)
    operator.forgive("412")


def drag(operator: PageUser, page: Page) -> None:
    """Drag the last step before the first one."""
    page.locator(".outline").evaluate("each => each.scrollIntoView({ block: 'center' })")
    grip = page.locator(".outline .grip").last.bounding_box()
    first = page.locator(".outline .step-row").nth(1).bounding_box()
    assert grip is not None and first is not None
    x, y = grip["x"] + grip["width"] / 2, grip["y"] + grip["height"] / 2
    operator.drag(x, y, right=first["x"] + 40 - x, down=first["y"] + 3 - y)
