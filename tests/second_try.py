"""Names tests that failed once and passed at the second try at the end of a run: each has to be looked into."""

import pytest

TITLE = "passed at the second try"


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """One plain line for each, which the logs of automatic runs show too."""
    stats = terminalreporter.stats
    failed = {report.nodeid for outcome in ("failed", "error") for report in stats.get(outcome, ())}
    tried_again = dict.fromkeys(report.nodeid for report in stats.get("rerun", ()))
    names = [name for name in tried_again if name not in failed]
    if names:
        terminalreporter.section(TITLE)
        for name in names:
            terminalreporter.write_line(f"{TITLE}: {name}")
