"""A test without a need besides the environment is left out, or fails."""

import pytest

from needs import VARIABLE, missing


def test_without_a_program_a_test_fails_and_names_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(pytest.fail.Exception, match="Chromium is missing: make chromium"):
        missing("Chromium", "make chromium")


def test_with_the_environment_alone_it_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "1")
    with pytest.raises(pytest.skip.Exception, match="left out: needs Chromium"):
        missing("Chromium", "make chromium")
