"""Names tests that failed once and passed at the second try at the end of a run: each has to be looked into."""

import pytest

TITLE = "passed at the second try"


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """One plain line for each, which the logs of automatic runs show too; and the seed of a run in which one failed."""
    stats = terminalreporter.stats
    if stats.get("failed") or stats.get("error") or stats.get("rerun"):
        terminalreporter.write_line(f"virtual time: --seed {config.getoption('--seed', 0)}")
    failed = {report.nodeid for outcome in ("failed", "error") for report in stats.get(outcome, ())}
    tried_again = dict.fromkeys(report.nodeid for report in stats.get("rerun", ()))
    names = [name for name in tried_again if name not in failed]
    if names:
        terminalreporter.section(TITLE)
        for name in names:
            terminalreporter.write_line(f"{TITLE}: {name}")
