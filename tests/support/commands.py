"""Requests to robots: bodies in Turtle, and actions found by links and recognised by their classes."""

from collections.abc import Container, Iterable, Mapping

import httpx
from rdflib import RDF, URIRef

from browser import DCTERMS, LF, ROS, Browser, Page

PREFIXES = """@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> .
@prefix unit: <http://qudt.org/vocab/unit/> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
@prefix lf: <https://w3id.org/linked-fleet#> .
"""
_TURTLE = {"content-type": "text/turtle"}
_PATIENCE_S = 90.0
_ATTEMPTS = 5


def scalar(value: object, unit: str = "unit:RAD", more: str = "") -> str:
    """Return the body of a joint's action; ``more``: further Turtle about its root, such as ``lf:speed [ ... ]``."""
    return f"<> vom:numericalValue {value} ; vom:unit {unit} ; {more} ."


def pose_body(
    link: str, xyz_m: Iterable[float], xyzw: Iterable[float] | None = None, more: str = 'lf:frame "base"'
) -> str:
    """Return the body of ``reach`` for the link with this IRI."""
    x, y, z = (f"{1000 * part:.6f}" for part in xyz_m)
    turned = ""
    if xyzw is not None:
        qx, qy, qz, qw = (f"{part:.9f}" for part in xyzw)
        turned = f"lf:orientation [ maths:x {qx} ; maths:y {qy} ; maths:z {qz} ; lf:w {qw} ] ;"
    return (
        f"<> lf:ofLink <{link}> ; {turned} "
        f"lf:position [ maths:x {x} ; maths:y {y} ; maths:z {z} ; vom:unit unit:MilliM ] ; {more} ."
    )


class Commanded:
    """One robot of a fleet: the IRIs of its joints and links by title, and requests to it and its joints."""

    def __init__(self, browser: Browser, name: str) -> None:
        self.browser, self.page = browser, browser.robot(name)
        self.joints, self.links = dict[str, str](), dict[str, str]()
        for part in self.page.graph.objects(self.page.iri, DCTERMS.hasPart):
            kinds = set(self.page.graph.objects(part, RDF.type))
            if LF.Component in kinds:
                continue
            of = self.links if ROS.Link in kinds else self.joints
            of[str(self.page.graph.value(part, DCTERMS.title))] = str(part)
        self._actions: dict[tuple[URIRef, str], str] = {}

    def action(self, kind: URIRef, joint: str = "") -> str:
        if (kind, joint) not in self._actions:
            thing = self.browser.page(self.joints[joint]) if joint else self.page
            self._actions[kind, joint] = self.browser.action(thing, kind)
        return self._actions[kind, joint]

    def ask(
        self, kind: URIRef, body: str = "", joint: str = "", method: str = "POST", **headers: str
    ) -> httpx.Response:
        """Invoke the action; an empty body is left out.

        Where robots run faster than the test, a delayed request may reach them too late; it is then repeated.
        """
        content = (PREFIXES + body).encode() if body else b""
        sent = (_TURTLE if body else {}) | {name.replace("_", "-"): value for name, value in headers.items()}
        url = self.action(kind, joint)
        for _ in range(_ATTEMPTS):
            answer = self.browser.http.request(method, url, content=content, headers=sent, timeout=_PATIENCE_S)
            if answer.status_code != 409 or "refused (stale)" not in answer.text:
                break
        return answer

    def begin(self, kind: URIRef, body: str = "", joint: str = "") -> str:
        """Begin a motion and return its invocation."""
        answer = self.ask(kind, body, joint)
        assert answer.status_code == 204, answer.text
        return answer.headers["location"]

    def do(self, kind: URIRef, body: str = "", joint: str = "", method: str = "POST") -> Page:
        """Execute an action and return the page of its invocation, which must have succeeded."""
        answer = self.ask(kind, body, joint, method, prefer="wait=60")
        assert answer.status_code == 204, answer.text
        page = self.browser.page(answer.headers["location"])
        assert page.one(LF.state) == LF.succeeded, page.response.text
        return page

    def assume(self, pose: str) -> Page:
        return self.do(LF.AssumePose, f'<> lf:poseName "{pose}" .')

    def targets(self, positions: Mapping[str, float], linear: Container[str] = ()) -> str:
        """Return ``lf:target`` of joints in rad, and in m for those in ``linear``."""
        nodes = (
            f"[ lf:ofJoint <{self.joints[name]}> ; vom:numericalValue {position!r} ; "
            f"vom:unit unit:{'M' if name in linear else 'RAD'} ]"
            for name, position in positions.items()
        )
        return f"lf:target {', '.join(nodes)}"

    def waypoints(self, rows: Mapping[float, Mapping[str, float]], linear: Container[str] = ()) -> str:
        """Return the body of ``followTrajectory``: positions by joint, by the time in seconds."""
        nodes = (f"[ lf:atTime {time_s!r} ; {self.targets(row, linear)} ]" for time_s, row in rows.items())
        return f"<> lf:waypoint {', '.join(nodes)} ."
