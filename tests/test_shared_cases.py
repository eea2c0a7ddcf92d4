"""Small inputs with the right value asserted, kept beside the checkout where they are at hand.

Each script is run by itself, from its own folder, and fails by an assertion.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CASES = Path(__file__).parents[2] / "shared" / "cases"
TIMED = {"r3_chaikin_setup", "r4_large_polygon", "f14_refine_channel_cost"}  # run by hand
SCRIPTS = [
    path
    for folder in ("faults", "field", "ground")
    for path in sorted((CASES / folder).glob("*.py"))
    if path.stem not in TIMED
]


@pytest.mark.skipif(not CASES.exists(), reason="the cases are not at hand")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_case(script):
    done = subprocess.run(
        [sys.executable, script],
        cwd=script.parent,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        timeout=600,
    )
    assert done.returncode == 0, done.stdout
