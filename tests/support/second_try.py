"""A second try for tests with real processes; the summary names them with the reason of the first failure."""

import pytest

OPTION = "--second-try"
TITLE = "passed at the second try"
TWICE = "failed at the second try too, and at the first with"


def add_option(parser: pytest.Parser) -> None:
    parser.addoption(OPTION, action="store_true", help="for tests marked processes that fail")


def pytest_itemcollected(item: pytest.Item) -> None:
    if item.config.getoption(OPTION) and item.get_closest_marker("processes"):
        item.add_marker(pytest.mark.flaky(reruns=1))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Write plain lines, which CI logs show too, and the seed of a run in which a test failed."""
    stats = terminalreporter.stats
    if stats.get("failed") or stats.get("error") or stats.get("rerun"):
        terminalreporter.write_line(f"virtual time: --seed {config.getoption('--seed', 0)}")
    failed = {report.nodeid for outcome in ("failed", "error") for report in stats.get(outcome, ())}
    reasons = {report.nodeid: report.longreprtext for report in stats.get("rerun", ())}
    if reasons:
        terminalreporter.section("second tries")
    for name, text in reasons.items():
        terminalreporter.write_line(f"{TWICE if name in failed else TITLE}: {name}")
        terminalreporter.write_line("\n".join(text.splitlines()[-40:]))
