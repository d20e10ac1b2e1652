"""The two formats of log lines."""

import json
import logging
import sys

import pytest

from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_runtime.log import JsonFormatter, TextFormatter


def test_only_known_forms_of_log_are_taken() -> None:
    with pytest.raises(ValueError, match="text or json"):
        GatewaySettings.read({}, ["--log-format", "xml"])


def test_text_and_traceback_of_a_record() -> None:
    record = logging.LogRecord("gateway.x", logging.ERROR, "", 0, "robot %s", ("a\nb\x1b[2J",), None)
    assert TextFormatter("%(levelname)s %(message)s").format(record) == "ERROR robot a\\x0ab\\x1b[2J"
    try:
        raise OSError("gone")
    except OSError:
        record.exc_info = sys.exc_info()
    said = json.loads(JsonFormatter().format(record))
    assert said["message"] == "robot a\nb\x1b[2J"
    assert said["exception"].endswith("OSError: gone")


def test_the_time_of_each_record_is_that_of_logging() -> None:
    form, formatter = "%(asctime)s %(message)s", TextFormatter("%(asctime)s %(message)s")
    for created in (1_800_000_000.0, 1_800_000_000.5, 1_800_000_001.999, 1_800_000_000.25):
        record = logging.LogRecord("gateway.x", logging.INFO, "", 0, "said", (), None)
        record.created, record.msecs = created, created % 1 * 1000
        assert formatter.format(record) == logging.Formatter(form).format(record)
