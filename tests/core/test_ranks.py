"""A lower rank never imports a higher one; bpy, gpu and the kernels have few importers."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from strata.addon.effects.registry import EFFECTS
from strata.tests.support.places import ROOT

# docs/architecture.md; the longest match counts. addon/bake.py is the one call of all faces.
RANKS = {
    "addon/core": 0,
    "addon/effects": 1,
    "addon/measure": 1,
    "addon/devices": 2,
    "addon/scene": 2,
    "addon/layers": 2,
    "addon/bake.py": 3,
    "addon/baked.py": 3,
    "addon/measuring.py": 3,
    "addon/passes.py": 3,
    "addon/planning.py": 3,
    "addon/expected.py": 3,
    "addon/speeds.py": 3,
    "addon/job.py": 3,
    "addon/audit": 4,
    "addon/report": 4,
    "addon/sequence.py": 4,
    "addon/sequence_samples.py": 4,
    "addon/ui": 4,
    "addon/preview": 4,
    "addon/engine": 4,
    "ops": 5,
    "__init__.py": 6,
    "__main__.py": 6,
}
# Who may import what, at any depth. Everything else in the package must run without Blender.
IMPORTERS = {
    "bpy": (
        *("addon/audit", "addon/report", "addon/scene", "addon/layers", "addon/ui", "addon/preview"),
        *("addon/engine", "ops"),
    ),
    "gpu": ("addon/devices/gpu", "addon/preview"),
    "gpu_extras": (),
    "bgl": (),
    "strata_kernels": ("addon/devices/cpu.py",),
    "OpenEXR": (),  # addon/layers/openexr.py says why
    "PIL": (),
    "strata": (),  # inside Blender the package has another name
}


def rank(path: str) -> int:
    """The rank of a file or folder, given relative to the root."""
    found = [prefix for prefix in RANKS if path == prefix or path.startswith(prefix + "/")]
    assert found, f"{path} has no rank"
    return RANKS[max(found, key=len)]


def package_files() -> list[str]:
    found = [*ROOT.glob("*.py"), *ROOT.glob("addon/**/*.py"), *ROOT.glob("ops/**/*.py")]
    return sorted(path.relative_to(ROOT).as_posix() for path in found)


def imports(path: str, source: str) -> Iterator[tuple[str, bool]]:
    """Every import: what (a path of the package, or a module's name) and whether it is of the package."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((alias.name.partition(".")[0], False) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module.partition(".")[0], False
        elif isinstance(node, ast.ImportFrom):
            base = Path(path).parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for alias in node.names:
                target = base / alias.name
                is_module = (ROOT / target).is_dir() or (ROOT / target).with_suffix(".py").is_file()
                target = target if is_module else base
                is_file = (ROOT / target).with_suffix(".py").is_file() and not (ROOT / target).is_dir()
                yield (target.with_suffix(".py") if is_file else target).as_posix(), True


def _effect_of(path: str) -> str:
    """The folder of the effect that a path lies in; empty for what several share, and elsewhere."""
    parts = Path(path).parts
    is_effect = parts[:2] == ("addon", "effects") and (ROOT / Path(*parts[:3])).is_dir()
    return parts[2] if is_effect and len(parts) > 2 and parts[2] != "shared" else ""


def breaches(path: str, source: str) -> list[str]:
    found = []
    for target, is_ours in imports(path, source):
        if is_ours:
            if path.startswith("addon/measure/") and target.startswith("addon/effects"):
                found.append(f"{path} imports {target}: it measures any effect's layers")
            if (of := _effect_of(path)) and (other := _effect_of(target)) and of != other:
                found.append(f"{path} imports {target}: what both use belongs in effects/shared")
            if target not in (".", "addon") and rank(target) > rank(path):
                found.append(f"{path} (rank {rank(path)}) imports {target} (rank {rank(target)})")
        elif target in IMPORTERS and not path.startswith(IMPORTERS[target] or ("/",)):
            found.append(f"{path} imports {target}")
    return found


@pytest.mark.parametrize("path", package_files())
def test_imports_go_down(path):
    assert breaches(path, (ROOT / path).read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("addon/core/graph.py", "from ..effects.registry import EFFECTS"),
        ("addon/core/graph.py", "def f():\n    from ... import ops"),
        ("addon/effects/registry.py", "from ..planning import Options"),
        ("addon/effects/toon/run.py", "from ..soft_shadow.steps import PREPARE"),
        ("addon/effects/toon/run.py", "def f():\n    from .. import soft_shadow"),
        ("addon/effects/toon/run.py", "from ...effects import soft_shadow"),
        ("addon/bake.py", "from .ui import panels"),
        ("addon/measure/verdict.py", "from ..effects.registry import EFFECTS"),
        ("addon/core/graph.py", "import bpy"),
        ("addon/bake.py", "import gpu.types"),
        ("addon/scene/scan.py", "from strata_kernels import raster"),
        ("ops/cli.py", "from strata.addon import bake"),
    ],
)
def test_breaches_are_found(path, source):
    assert len(breaches(path, source)) == 1


# What works for any effect names none: neither its id nor its layers.
NAMELESS = ("addon/core", "addon/measure", "addon/devices", "addon/scene", "addon/effects/shared")


def named_effects(source: str) -> set[str]:
    """Effects that a text names."""
    found = set()
    for effect in EFFECTS:
        words = re.escape(effect.id).replace("_", "[ _-]?")
        titles = "|".join(re.escape(kind.title) for kind in effect.layers)
        if re.search(words, source, re.IGNORECASE) or re.search(rf"\b({titles})\b", source):
            found.add(effect.id)
    return found


def test_what_works_for_any_effect_names_none():
    files = [path for folder in NAMELESS for path in sorted((ROOT / folder).rglob("*"))]
    texts = [path for path in files if path.suffix in (".py", ".glsl")]
    named = {path.relative_to(ROOT).as_posix(): named_effects(path.read_text("utf-8")) for path in texts}
    assert {path: effects for path, effects in named.items() if effects} == {}
    assert named_effects("as `Toon Outline` has it") == {"toon"}
    assert named_effects("kernels/src/volumetric_light") == {"volumetric_light"}
    assert named_effects("soft shadows") == {"soft_shadow"}


def test_nothing_changes_the_module_path():
    """Blender shows users every extension that does."""
    for path in package_files():
        assert "sys.path" not in (ROOT / path).read_text(encoding="utf-8"), path


def test_tests_and_scripts_are_imported_as_parts_of_the_package():
    """Only the kernels are given to a Blender that has none by a folder in the module path."""
    files = [path for folder in ("tests", "scripts") for path in ROOT.glob(f"{folder}/**/*.py")]
    change = re.compile(r"sys\.path(\.\w+\(|\[.*\] =| \+= | = )")
    found = {path.name for path in files if change.search(path.read_text(encoding="utf-8"))}
    assert found == {"gpu_blender_check.py", "preview_window.py"}


def test_gpu_is_never_imported_on_the_way_in():
    """A module-level import would run while Blender enables the extension, perhaps without a GPU context."""
    for path in package_files():
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        top_level = [node for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom))]
        names = [alias.name for node in top_level for alias in node.names]
        names += [node.module or "" for node in top_level if isinstance(node, ast.ImportFrom)]
        if not path.startswith(IMPORTERS["gpu"]):
            assert "gpu" not in names, path
