"""The parts in which CI runs the tests hold every test once."""

from __future__ import annotations

import re
import subprocess

from strata.tests.support.places import ROOT


def test_each_folder_of_tests_is_in_one_part():
    command = ["make", "--dry-run", "test-unit", "test-devices", "test-window"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    parts = re.findall(r"tests/\w+", "".join(line for line in told.splitlines() if "-m pytest" in line))
    folders = {path.relative_to(ROOT / "tests").parts[0] for path in ROOT.glob("tests/**/test_*.py")}
    assert sorted(parts) == sorted(f"tests/{folder}" for folder in folders)
    assert set(re.findall(r"(?<=set -- ).*", (ROOT / ".ci" / "run").read_text())) == {"unit devices window"}
