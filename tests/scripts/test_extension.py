"""The zip that users install: what is in it, and that it works where nothing of Strata is."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from strata.scripts.build.extension import generated, source_files
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.places import ROOT

CHECK = (ROOT / "scripts" / "in_blender.py", "--", "strata.tests.scripts.extension_check")
# All that the pip-installed Blender needs, and nothing of ours.
BLENDER_PACKAGES = ("bpy", "numpy", "cattrs", "attrs", "requests", "zstandard", "certifi", "idna", "urllib3",
                    "charset_normalizer", "typing_extensions")  # fmt: skip


@pytest.fixture(scope="session")
def bare_python(tmp_path_factory) -> Path:
    """A Python with the pip-installed Blender and without the kernels and Strata."""
    from importlib.metadata import distribution

    folder = tmp_path_factory.mktemp("bare")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    (site,) = (folder / "venv" / "lib").glob("python*/site-packages")
    for name in BLENDER_PACKAGES:
        files = distribution(name).files
        for top in {file.parts[0] for file in files if file.parts[0] not in ("..", "__pycache__")}:
            (site / top).symlink_to(distribution(name).locate_file(top))
    return folder / "venv" / "bin" / "python"


def test_versions_agree():
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    kernels = tomllib.loads((ROOT / "kernels" / "pyproject.toml").read_text())["project"]
    crate = tomllib.loads((ROOT / "kernels" / "Cargo.toml").read_text())["package"]
    assert manifest["version"] == project["version"] == kernels["version"] == crate["version"]
    assert list(manifest["permissions"]) == ["files"]


def test_zip_holds_what_belongs_and_nothing_else(archive):
    with zipfile.ZipFile(archive) as opened:
        names = {name for name in opened.namelist() if not name.endswith("/")}
        manifest = tomllib.loads(opened.read("blender_manifest.toml").decode())
    wheels = {name for name in names if name.startswith("wheels/")}
    made = set(generated())
    assert names - wheels == {*source_files(), *made, "blender_manifest.toml"}
    assert "addon/ui/presets/strata/soft_shadow/Draft.py" in made
    assert {f"./{name}" for name in wheels} == set(manifest["wheels"])
    assert [Path(name).name.split("-")[:4] for name in wheels] == [
        ["strata_kernels", manifest["version"], "cp313", "abi3"]
    ]
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    ours = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True).stdout.split()
    if ours:  # a source archive has no repository
        assert names - wheels - made <= set(ours), "the zip holds a file that the repository ignores"


def test_kernels_name_no_folder_of_whoever_built_them(archive):
    """The Makefile maps them away; a kernel built without it would show here."""
    with zipfile.ZipFile(archive) as opened:
        (name,) = (name for name in opened.namelist() if name.endswith(".whl"))
        with zipfile.ZipFile(io.BytesIO(opened.read(name))) as wheel:
            (library,) = (wheel.read(name) for name in wheel.namelist() if name.endswith(".so"))
    for folder in (ROOT, Path.home()):
        assert f"{folder}/".encode() not in library, folder


def test_installs_bakes_and_leaves_nothing(archive, bare_python, tmp_path):
    """In the pip-installed Blender."""
    scene = ROOT / "sample_blends" / "courtyard.blend"
    words = [bare_python, *CHECK, archive, scene, tmp_path / "out.exr"]
    env = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path / "home")}
    env.pop("PYTHONPATH", None)
    result = subprocess.run(list(map(str, words)), env=env, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "nothing left" in result.stdout
    assert read_layers(tmp_path / "out.exr").layers


def check_blender_binary(archive, tmp_path):
    """Whose Python is another one than that which built the kernels: proves the stable ABI."""
    home = tmp_path / "home"
    shutil.copy(ROOT / "sample_blends" / "courtyard.blend", tmp_path)
    scene, out = tmp_path / "courtyard.blend", tmp_path / "out.exr"
    env = {**os.environ, "BLENDER_USER_RESOURCES": str(home)}

    def blender(*words):
        command = list(map(str, (os.environ["BLENDER"], *words)))
        return subprocess.run(command, env=env, capture_output=True, text=True, timeout=300)

    result = blender("-b", "--factory-startup", "--python", *CHECK, archive, scene, out)
    assert "nothing left" in result.stdout, result.stdout + result.stderr
    assert "EXR_ERR" not in result.stderr
    assert read_layers(out).layers

    installed = blender("--command", "extension", "install-file", "-r", "user_default", "-e", archive)
    assert installed.returncode == 0, installed.stdout + installed.stderr
    words = (
        "--size",
        "96x54",
        "--samples",
        "1",
        "--probes",
        "0",
        "--backend",
        "cpu",
        "-o",
        tmp_path / "c.exr",
    )
    baked = blender("-b", scene, "--command", "strata", "bake", *words)
    assert baked.returncode == 0, baked.stdout + baked.stderr
    assert read_layers(tmp_path / "c.exr").layers
    refused = blender("-b", scene, "--command", "strata", "bake", "-o", scene / "c.exr")
    assert refused.returncode == 2
    assert "is not a folder" in refused.stderr


if "BLENDER" in os.environ:  # a whole Blender with its own Python; CI makes one
    test_installs_in_a_blender_binary = check_blender_binary
