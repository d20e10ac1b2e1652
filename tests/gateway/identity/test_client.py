"""The client sends its credentials only to its own fleet."""

import json
from pathlib import Path

import pytest

from authenticated_gateway import AuthenticatedGateway
from linked_fleet_client.cli.main import REFUSED, main
from linked_fleet_client.conform import command
from linked_fleet_client.fleet import Fleet
from receivers import Answer, receiving

pytestmark = pytest.mark.virtual


def test_the_command_line_takes_a_token(
    here: AuthenticatedGateway, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LINKED_FLEET_URL", here.root)

    def ls(token: str) -> tuple[int, int]:
        """Return the exit code and the number of listed robots."""
        monkeypatch.setenv("LINKED_FLEET_TOKEN", token)
        return main(["ls"]), capsys.readouterr().out.count("Robot")

    assert ls(here.tokens["lab"]) == (0, 1)
    code, robots = ls(here.tokens["all"])
    assert (code, robots >= 2) == (0, True)
    assert ls("") == (REFUSED, 0)


def test_conformance_is_checked_as_who_has_the_token(
    here: AuthenticatedGateway, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a file or from the environment; an invalid token is wrong usage, and is not printed."""
    file = tmp_path / "token"
    file.write_text(here.tokens["lab"] + "\n")
    few = ["--json", "--no-write", "--resources", "8"]

    def outcomes(*more: str) -> dict[str, str]:
        assert command([here.root, *few, *more]) in (0, 1)
        said = capsys.readouterr().out
        assert here.tokens["lab"] not in said
        return {result["id"]: result["outcome"] for result in json.loads(said)["results"]}

    known = outcomes("--token-file", str(file))
    assert {known[name] for name in ("R0.1", "R0.4", "R0.9", "R0.15")} == {"passed"}
    assert outcomes()["R0.4"] != "passed"
    monkeypatch.setenv("LINKED_FLEET_TOKEN", here.tokens["lab"])
    assert outcomes()["R0.4"] == "passed"
    for text in ("", "two words", "a\r\nb: c"):
        file.write_text(text)
        with pytest.raises(SystemExit) as ended:
            command([here.root, "--token-file", str(file)])
        assert ended.value.code == 2 and (not text or text not in capsys.readouterr().err)


def test_a_token_goes_nowhere_else(here: AuthenticatedGateway) -> None:
    with receiving() as other, Fleet(here.root, token=here.tokens["lab"]) as fleet:
        other.default = Answer(200, {"Content-Type": "text/turtle"}, b"<> a <http://x.example/Thing> .")
        fleet.web.get(other.url("/elsewhere"))
        (seen,) = other.wait(1)
        assert "authorization" not in seen.headers
        assert fleet.web.get(here.root).graph
