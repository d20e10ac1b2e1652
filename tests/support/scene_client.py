"""A client of the world: it places robots and puts objects beside them, all found by links."""

import math

import httpx

from browser import LDP, LF, Browser, Page
from commanding import PREFIXES, TURTLE, problem


def world(browser: Browser) -> Page:
    return browser.page(str(browser.page(browser.root).one(LF.world)))


def placement(browser: Browser, robot: str) -> str:
    return str(browser.robot(robot).one(LF.placement))


def container(browser: Browser) -> Page:
    return browser.page(str(world(browser).one(LF.objects)))


def contents(browser: Browser) -> list[str]:
    page = container(browser)
    return [str(each) for each in page.graph.objects(page.iri, LDP.contains)]


def stands(x: float, y: float, z: float, turned_rad: float = 0.0) -> str:
    turn = f"maths:x 0 ; maths:y 0 ; maths:z {math.sin(turned_rad / 2)} ; lf:w {math.cos(turned_rad / 2)}"
    return f"lf:position [ maths:x {x} ; maths:y {y} ; maths:z {z} ; vom:unit unit:M ] ; lf:orientation [ {turn} ]"


def put_robot(browser: Browser, robot: str, *where: float) -> None:
    answer = browser.http.put(placement(browser, robot), content=f"{PREFIXES}<> {stands(*where)} .", headers=TURTLE)
    assert answer.status_code == 204, answer.text


def crate(title: str, *where: float, kind: str = "lf:Obstacle", size_mm: float = 300) -> str:
    box = f"maths:x {size_mm} ; maths:y {size_mm} ; maths:z {2 * size_mm} ; vom:unit unit:MilliM"
    geometry = f"lf:geometry [ a lf:Box ; lf:size [ {box} ] ]"
    return f'{PREFIXES}<> a {kind} ; dcterms:title "{title}" ; {stands(*where)} ; {geometry} .'


def put_object(browser: Browser, body: str) -> str:
    answer = browser.http.post(container(browser).url, content=body, headers=TURTLE)
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def met(answer: httpx.Response) -> list[str]:
    assert problem(answer) == (409, "collision"), answer.text
    assert 0 <= answer.json()["share"] <= 1
    things: list[str] = answer.json()["things"]
    assert len(answer.json()["names"]) == len(things)
    assert len(answer.json()["point"]) == 3
    return things
