"""Builds the zip that Blender installs: dist/strata-<version>-<platform>.zip.

Works on a copy of exactly the files that belong in it, so that nothing else can slip through, and with the
builder that comes with Blender itself.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

from strata.scripts.build.docs_html import pages
from strata.scripts.build.effect_presets import presets

ROOT = Path(__file__).resolve().parents[2]
STAGE = ROOT / "build" / "extension"
DIST = ROOT / "dist"
PRESETS = "addon/ui/presets"  # where `make setup` writes them; the zip's are made anew
# The kernels' source travels with their binary: whoever gets the one gets the other.
SOURCES = (
    "__init__.py", "LICENSE", "addon/**/*.py", "addon/**/*.glsl", "ops/*.py",
    "kernels/Cargo.toml", "kernels/Cargo.lock", "kernels/pyproject.toml", "kernels/src/**/*.rs",
)  # fmt: skip


def generated() -> dict[str, str]:
    """By their paths in the zip: pages for a browser, docs/index.html the first, and presets."""
    documents = {f"docs/{name}": text for name, text in pages().items()}
    return documents | {f"{PRESETS}/{name}": text for name, text in presets().items()}


def source_files(root: Path = ROOT) -> list[str]:
    """Paths, relative to `root`, of everything in the zip but the manifest, the wheels and what is made."""
    found = {path.relative_to(root).as_posix() for pattern in SOURCES for path in root.glob(pattern)}
    return sorted(path for path in found if not path.startswith(f"{PRESETS}/"))


def blender_ext(*words: str) -> None:
    """Runs Blender's own extension tool, as `blender --command extension` does."""
    bpy_folder = Path(find_spec("bpy").origin).parent
    tool = next(bpy_folder.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    result = subprocess.run([sys.executable, str(tool), *words], capture_output=True, text=True)
    if result.returncode:
        sys.exit(f"{' '.join(words)}:\n{result.stdout}{result.stderr}")


def stage_wheel(folder: Path) -> str:
    """Copies the kernels' wheel, built by `make setup`; its name."""
    folder.mkdir(parents=True)
    wheels = sorted((DIST / "wheels").glob("strata_kernels-*.whl"), key=lambda path: path.stat().st_mtime)
    if not wheels:
        sys.exit("no wheel of the kernels: run 'make setup' first")
    shutil.copy2(wheels[-1], folder)
    return wheels[-1].name


def stage() -> Path:
    """A fresh folder that holds exactly what goes into the zip."""
    shutil.rmtree(STAGE, ignore_errors=True)
    paths = source_files()
    for path in paths:
        (STAGE / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, STAGE / path)
    for path, text in generated().items():
        (STAGE / path).parent.mkdir(parents=True, exist_ok=True)
        (STAGE / path).write_text(text, encoding="utf-8")
        paths.append(path)
    wheels = [f"./wheels/{stage_wheel(STAGE / 'wheels')}"]
    # A top-level key has to come before the manifest's tables; JSON's lists of strings are TOML's too.
    manifest = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    manifest = f"wheels = {json.dumps(wheels, indent=1)}\n{manifest}"
    manifest += f"\n[build]\npaths = {json.dumps(paths, indent=1)}\n"
    (STAGE / "blender_manifest.toml").write_text(manifest, encoding="utf-8")
    return STAGE


def main() -> None:
    folder = stage()
    manifest = tomllib.loads((folder / "blender_manifest.toml").read_text(encoding="utf-8"))
    (platform,) = manifest["platforms"]
    # Named by hand: Blender 5.2's --split-platforms takes other files for wheels where [build] has paths.
    built = DIST / f"{manifest['id']}-{manifest['version']}-{platform.replace('-', '_')}.zip"
    blender_ext("validate", str(folder))
    blender_ext("build", f"--source-dir={folder}", f"--output-filepath={built}")
    blender_ext("validate", str(built))
    count = len(manifest["build"]["paths"])
    print(f"{built.relative_to(ROOT)}: {built.stat().st_size / 1e6:.1f} MB, {count} files")


if __name__ == "__main__":
    main()
