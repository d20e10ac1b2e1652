"""A gateway on a system without a library that Pinocchio is linked with refuses what needs it, and says why."""

from pathlib import Path

import httpx
import pytest

from browser import LF
from commanding import PREFIXES, of_joint, of_robot, post, problem
from running import eventually
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
PAN = "shoulder_pan_joint"
BODY = PREFIXES + "[] vom:numericalValue 5 ; vom:unit unit:DEG ."


def test_what_needs_the_library_is_503_and_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = Place(tmp_path / "state")
    (tmp_path / "libgomp.so.1").touch()
    with place.ur5():
        monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))  # the loader finds the empty file instead of the library
        with place.gateway() as (gateway, browser):
            live(browser, "ur5")

            def refused(answer: httpx.Response, code: str) -> None:
                assert problem(answer) == (503, code), answer.text
                assert "libgomp.so.1: file too short" in answer.json()["detail"]
                assert "linked-fleet doctor" in answer.json()["detail"]

            link = str(browser.part("ur5", "tool0").iri)
            point = "lf:position [ maths:x 0.4 ; maths:y 0.1 ; maths:z 0.4 ; vom:unit unit:M ]"
            refused(
                post(browser, of_robot(browser, LF.Reach), f"{PREFIXES}[] lf:ofLink <{link}> ; {point} ."),
                "library-missing",
            )
            query = (
                f"PREFIX lf: <https://w3id.org/linked-fleet#> SELECT (lf:canReach(<{link}>, 0.4, 0.1, 0.4) AS ?x) {{}}"
            )
            asked = browser.http.post(
                f"{browser.root}query", content=query, headers={"content-type": "application/sparql-query"}
            )
            refused(asked, "library-missing")
            assert "The gateway cannot load pinocchio" in gateway.output
            assert post(browser, of_joint(browser, PAN), BODY).status_code == 204, "a robot without a placement moves"
            put = browser.http.put(
                str(browser.robot("ur5").one(LF.placement)),
                content=f"{PREFIXES}<> lf:position [ maths:x 0 ; maths:y 0 ; maths:z 0 ; vom:unit unit:M ] .",
                headers={"content-type": "text/turtle"},
            )
            assert put.status_code == 204, put.text
            eventually(lambda: "no motion near ur5 can be checked" in gateway.output, "the log line")
            refused(post(browser, of_joint(browser, PAN), BODY), "unchecked")
