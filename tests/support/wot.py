"""The requirements on a Thing Description: its JSON Schema, from npm (things/tests/package.json)."""

import contextlib
import functools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from jsonschema import Draft7Validator, FormatChecker

from needs import missing
from running import PATIENCE_S

HERE = Path(__file__).parents[2] / "gateway/linked_fleet_gateway/extensions/things/tests"
_SCHEMA = HERE / "node_modules/wot-thing-description-types/schema/td-json-schema-validation.json"


def node() -> str:
    """Return the command that runs JavaScript."""
    found = shutil.which("node") or shutil.which("node", path=str(Path(sys.executable).parent))
    if found is None or not _SCHEMA.is_file():
        missing("Node.js with node-wot", "make node-wot")
    return found


def printed(script: Path, *arguments: str) -> dict[str, object]:
    """Run a client in JavaScript, and return the members of all JSON objects that it prints, a line each."""
    command, packages = [node(), script, *arguments], {"NODE_PATH": str(HERE / "node_modules")}
    done = subprocess.run(
        command, env=os.environ | packages, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, object] = {}
    for line in done.stdout.splitlines():
        with contextlib.suppress(json.JSONDecodeError):
            found |= json.loads(line)
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
    """Return True if a value matches its data schema in a Thing Description, with ``nullable`` as in Ajv (node-wot)."""
    return Draft7Validator(_with_null(schema), format_checker=FormatChecker()).is_valid(value)


def _with_null(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_with_null(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    found = {name: _with_null(each) for name, each in schema.items()}
    return found | {"type": [found["type"], "null"]} if found.get("nullable") is True else found
