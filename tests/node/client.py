"""Programs of npm that read our exports back: npm install --no-package-lock --prefix tests/node."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent
SECONDS = 120


def require(package: str) -> None:
    """Skip the test where node or a package is not there, and say what to run."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    if not (HERE / "node_modules" / package).is_dir():
        pytest.skip(f"{package} is not installed: npm install --no-package-lock --prefix tests/node")


def run_node(script: str, *arguments: str) -> object:
    """Run a script of this folder and read the JSON that it prints."""
    done = subprocess.run(
        ["node", str(HERE / script), *arguments], capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)
