"""Certificates for Zenoh links in tests, made by the script that operators use."""

import subprocess
import sys
from pathlib import Path

from running import ROOT

SCRIPT = ROOT / "deploy" / "certificates"


def made(folder: Path, *arguments: str) -> Path:
    """Run deploy/certificates for a folder and return the folder."""
    done = subprocess.run([sys.executable, str(SCRIPT), str(folder), *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder
