"""A page of each kind in the demo as shipped, and what a reader would stumble over on them."""

from typing import Any

from playwright.sync_api import expect
from rdflib import Literal, URIRef

from accessibility import violations_in_both_schemes
from browser import HYBRIT, LDP, LF, ROS, Browser
from commanding import PREFIXES, TURTLE, radian
from page_user import PageUser
from plain_words import FOR_PROGRAMS, faults
from rules_client import BY_SIDE, a_rule, fired, posted, sides
from running import eventually

READ = """(hidden) => {
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    const found = [];
    while (walker.nextNode()) {
        const { parentElement: parent, data } = walker.currentNode;
        if (data.trim() && !parent.closest(hidden)) found.push(data.trim());
    }
    return found;
}"""
# A query and a shape in Turtle are for programs, wherever an editor shows them. What is for browsers without scripts
# is not seen.
FOR_PROGRAMS_ON_SCREEN = ", ".join((*FOR_PROGRAMS, ".cm-editor", ".solutions", "noscript"))
CRATE = f"""{PREFIXES}
<> a lf:Obstacle ; dcterms:title "crate" ; lf:position [ maths:x 9 ; maths:y 9 ; maths:z 0 ; vom:unit unit:M ] ;
    lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue 0.2 ; vom:unit unit:M ] ] .
"""


def pages_of_each_kind(browser: Browser) -> dict[str, str]:
    """Make things of each kind in the demo, and return the address of a page of each."""
    robot, joint, root = browser.robot("ur5"), browser.part("ur5", "elbow_joint"), browser.page(browser.root)
    rotate, stop = browser.action(joint, LF.Rotate), browser.action(robot, LF.StopRobot)
    tiago, history = browser.part("tiago", "torso_lift_joint"), str(robot.one(LF.history))
    rotation = str(next(joint.graph.objects(joint.iri, ROS.rotation)))
    subscribed = browser.http.post(str(joint.one(HYBRIT.subscriptions)), content=_watching(rotation), headers=TURTLE)
    assert subscribed.status_code == 201, subscribed.text
    _turn(browser, rotate, 0.0)
    rule = posted(browser, a_rule(sides(joint.url, 0.2), stop, more=BY_SIDE))
    eventually(lambda: browser.page(rule).one(LF.state) == LF.active, "evaluated once")
    _turn(browser, rotate, 0.4)
    fired(browser, rule, 1)
    world = browser.page(str(root.one(LF.world)))
    crate = browser.http.post(str(world.one(LF.objects)), content=CRATE, headers=TURTLE)
    assert crate.status_code == 201, crate.text
    ask: dict[str, Any] = {
        "type": "sequence",
        "steps": [{"type": "confirm", "text": "Go on?"}, {"type": "invoke", "action": rotate}],
    }
    ask["steps"][1]["body"] = {"value": 0.1, "unit": "http://qudt.org/vocab/unit/RAD"}
    mission = browser.http.post(browser.root + "missions", json={"title": "A mission", "step": ask}).headers["location"]
    run = browser.http.post(mission + "/actions/run").headers["location"]
    noise = {"about": robot.url, "title": "It rattles."}
    assert browser.http.post(browser.root + "actions/raiseFault", json=noise).status_code == 204
    (fault,) = browser.page(browser.root + "faults").graph.subjects(LF.faultKind, Literal("told"))
    order = browser.http.post(browser.root + "queue", json={"mission": mission, "deadline": "2099-01-01T00:00:00Z"})
    planned = {"order": {"mission": mission}, "rule": "FREQ=DAILY", "start": "2099-01-01T00:00", "timeZone": "UTC"}
    schedule = browser.http.post(browser.root + "schedules", json=planned)
    return {
        "recording": eventually(lambda: _first(browser, robot.url + "recordings"), "a recording"),  # others replace it
        "recordings": robot.url + "recordings",
        "fleet": browser.root,
        "robot": robot.url,
        "walker": browser.robot("go2").url,
        "joint": joint.url,
        "prismatic": tiago.url,
        "link": browser.part("ur5", "wrist_3_link").url,
        "property": str(next(joint.graph.objects(joint.iri, LF.velocity))),
        "setting": str(robot.property(LF.TextProperty)),
        "action": rotate,
        "nested action": browser.action(robot, LF.FollowTrajectory),
        "invocation": browser.http.post(stop, headers={"prefer": "wait=30"}).headers["location"],
        "invocations": rotate + "/invocations",
        "subscriptions": str(joint.one(HYBRIT.subscriptions)),
        "subscription": subscribed.headers["location"],
        "blueprint": rotate.removesuffix("/actions/rotate") + "/blueprint",
        "vocabulary": str(root.one(LF.vocabulary)),
        "lease": str(robot.one(LF.lease)),
        "annotations": robot.url + "annotations",
        "stops that hold": browser.root + "stopLatches",
        "notes": browser.root + "notes",
        "boards": browser.root + "boards",
        "board": browser.http.post(browser.root + "boards", json={"title": "Elbows", "lines": [rotation]}).headers[
            "location"
        ],
        "notes of a robot": robot.url + "notes",
        "note": browser.http.post(browser.root + "notes", json={"about": robot.url, "text": "Mind the cable."}).headers[
            "location"
        ],
        "poses": robot.url + "poses",
        "pose": browser.http.post(robot.url + "poses", json={"title": "here"}).headers["location"],
        "camera": browser.root + "tiago/cameras/head",
        "cameras": browser.root + "tiago/cameras",
        "all cameras": browser.root + "cameras",
        "joint state": str(robot.one(LF.jointState)),
        "histories": str(root.one(LF.histories)),
        "history": history,
        "history of a property": rotation + "/history",
        "history of components": robot.url + "history/values",
        "audit": browser.root + "audit",
        "people": browser.root + "people",
        "requests for control": browser.root + "control-requests",
        "timeline": str(root.one(LF.timeline)),
        "world": world.url,
        "objects": str(world.one(LF.objects)),
        "object": crate.headers["location"],
        "map": str(world.one(LF.map)),
        "collisions": str(world.one(LF.collisions)),
        "rules": str(root.one(LF.rules)),
        "rule": rule,
        "firings": rule + "/firings",
        "missions": str(root.one(LF.missions)),
        "mission": mission,
        "mission builder": f"{root.one(LF.missions)}/builder?mission={mission.rpartition('/')[2]}",
        "runs": browser.root + "mission-runs",
        "run": f"{browser.root}mission-runs/{run.rpartition('/')[2]}",
        "faults": browser.root + "faults",
        "fault": str(fault),
        "queue": str(root.one(LF.queue)),
        "order": order.headers["location"],
        "schedules": str(root.one(LF.schedules)),
        "schedule": schedule.headers["location"],
        "query": str(root.one(LF.query)),
        "results": browser.root + "query?query=SELECT%20%3Fa%20%7B%20%3Fa%20a%20%3Fb%20%7D%20LIMIT%209",
        "no query": browser.root + "query?query=SELECT",
        "things": str(root.one(LF.things)),
        "nothing": browser.root + "nothing/of/this/name",
    }


def _first(browser: Browser, container: str) -> str:
    """Return the first member of a container; empty if it is not there yet, or has none."""
    if browser.http.get(container).status_code != 200:
        return ""
    graph = browser.page(container).graph
    return next((str(each) for each in graph.objects(URIRef(container), LDP.contains)), "")


def _turn(browser: Browser, rotate: str, angle: float) -> None:
    answer = browser.http.put(rotate, content=radian(angle), headers=TURTLE | {"prefer": "wait=30"}, timeout=40)
    assert answer.is_success, answer.text


def _watching(resource: str) -> str:
    watches = f"<{HYBRIT.onResource}> <{resource}> ; <{HYBRIT.callbackURL}> 'http://127.0.0.1:9/nobody'"
    return f"<> a <{HYBRIT.Subscription}>, <{HYBRIT.WebCallback}> ; {watches} ."


def obstacles(operator: PageUser, pages: dict[str, str]) -> list[Any]:
    """Return the violations in light and dark mode, sideways scrolling, and words that are not plain, of all pages.

    All actions are unfolded.
    """
    page, found = operator.page, list[Any]()
    for kind, url in pages.items():
        page.emulate_media(color_scheme="light")
        page.goto(url)
        for details in page.locator("details.action").all():
            details.locator("summary").first.click()
            expect(details.locator("form.invoke, .problem").first).to_be_visible()
        if page.locator("#in-sparql").count():  # folded where rules can be made without it
            expect(page.locator(".composer")).to_be_visible()
            page.locator("#in-sparql > summary").click()
        if page.locator("textarea[data-editor]").count():
            expect(page.locator(".cm-editor").first).to_be_visible()
        found += [(kind, *each) for each in violations_in_both_schemes(page)]
        found += [] if operator.fits() else [(kind, "scrolls sideways")]
        found += [(kind, each) for text in page.evaluate(READ, FOR_PROGRAMS_ON_SCREEN) for each in faults(text)]
    operator.forgive("404", "400")
    return found
