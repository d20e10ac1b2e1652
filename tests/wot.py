"""The requirements on a Thing Description: its JSON Schema, from npm (things/tests/package.json)."""

import functools
import json
import shutil
import sys
from pathlib import Path

import pytest
from jsonschema import Draft7Validator, FormatChecker

HERE = Path(__file__).parents[1] / "gateway/linked_fleet_gateway/extensions/things/tests"
_SCHEMA = HERE / "node_modules/wot-thing-description-types/schema/td-json-schema-validation.json"


def node() -> str:
    """Return the command that runs JavaScript."""
    found = shutil.which("node") or shutil.which("node", path=str(Path(sys.executable).parent))
    if found is None or not _SCHEMA.is_file():
        pytest.fail("node-wot is not there: make node-wot", pytrace=False)
    return found


@functools.cache
def _validator() -> Draft7Validator:
    node()
    return Draft7Validator(json.loads(_SCHEMA.read_text()), format_checker=FormatChecker())


def conforms(td: object) -> None:
    """Validate a Thing Description against the schema of version 1.1."""
    errors = [f"{each.json_path}: {each.message[:300]}" for each in _validator().iter_errors(td)]
    assert not errors, "\n".join(errors)


def fits(value: object, schema: object) -> bool:
    """Return True if a value matches its data schema in a Thing Description."""
    return Draft7Validator(schema, format_checker=FormatChecker()).is_valid(value)
