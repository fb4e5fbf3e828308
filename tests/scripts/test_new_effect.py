"""docs/new_effect.md, followed to the letter in a copy of Strata."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GUIDE = (ROOT / "docs/new_effect.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^`([\w./]+)`\n\n```\w+\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL))
LINE = re.search(r"^```python registry\n(.*)\n```$", GUIDE, re.MULTILINE)[1]
COPIED = ("addon", "ops", "tests", "scripts", "__init__.py", "__main__.py", "pyproject.toml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Holds `strata`, a copy that has the effect of the guide."""
    folder = tmp_path_factory.mktemp("new_effect")
    copy = folder / "strata"
    copy.mkdir()
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, copy / name)
    for path, text in FILES.items():
        (copy / path).parent.mkdir(parents=True, exist_ok=True)
        (copy / path).write_text(text, encoding="utf-8")
    registry = copy / "addon/effects/registry.py"
    text = registry.read_text(encoding="utf-8")
    text = text.replace("from .soft_shadow", f"{LINE}\nfrom .soft_shadow", 1)
    listed, count = re.subn(r"^(EFFECTS\b.*\w)(\)+)$", r"\1, DISTANCE_FADE\2", text, flags=re.MULTILINE)
    assert count == 1
    registry.write_text(listed, encoding="utf-8")
    return folder


def run(folder: Path, *words: str) -> str:
    """What `python -m ...` says there, whose `strata` is the copy."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, "-m", *words], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_guide_names_its_files():
    assert len(FILES) == 9
    assert all("distance_fade" in path for path in FILES)


def test_its_code_is_formatted_as_ours(folder):
    files = [path for path in FILES if path.endswith(".py")]
    ruff = shutil.which("ruff", path=str(Path(sys.executable).parent))
    for command in (("format", "--check"), ("check",)):
        done = subprocess.run([ruff, *command, *files], cwd=folder / "strata", capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("backend", ["cpu", "gpu"])
def test_the_effect_bakes_and_tells_its_error(folder, backend):
    if backend == "gpu":
        from strata.tests.support.gpu_scenes import gpu_device

        gpu_device()
    words = ["--effects", "distance_fade", "--size", "96x54", "--samples", "8", "--probes", "256"]
    scene = str(ROOT / "sample_blends/stacked.blend")
    output = ["-o", f"{backend}.exr", "--report", f"{backend}.json", "--backend", backend, "-q"]
    run(folder, "strata", "bake", scene, *words, *output)
    report = json.loads((folder / f"{backend}.json").read_text(encoding="utf-8"))
    (layer,) = report["layers"]
    assert layer["name"] == "Distance Fade"
    assert [step["device"] for step in report["steps"] if "distance_fade" in step["name"]] == [backend]
    # Silhouettes by 8 samples: what a mask's pixel there is off by (docs/accuracy.md).
    assert layer["error"]["mean_absolute_error"] < 0.01


def test_it_stands_in_every_face(folder):
    described = json.loads(run(folder, "strata", "effects", "--json"))
    assert [each["id"] for each in described][-1] == "distance_fade"
    plan = run(
        folder, "strata", "plan", str(ROOT / "sample_blends/plain.blend"), "--effects", "distance_fade"
    )
    assert "Distance Fade" in plan


def test_its_own_tests_pass(folder):
    """On a GPU too where there is one; where there has to be one, they fail without."""
    tests = ("strata/tests/effects/distance_fade", "strata/tests/effects/test_extremes.py")
    said = run(folder, "pytest", "-p", "no:cacheprovider", *tests, "-k", "distance_fade")
    assert re.search(r"\b(3 passed|[12] passed, [12] skipped)", said, re.MULTILINE), said
