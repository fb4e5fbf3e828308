"""Measures the preview in a real Blender window and writes what it finds into docs/performance.md.

BLENDER=/path/to/blender python -m strata.scripts.bench.preview [--eevee] [--no-window] [--trace TRACE.json]

With --trace it only traces how lights are dragged (docs/trace.md). Needs Xvfb where there is no screen.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
import strata_kernels
from strata.addon.bake import BakeJob, read_scene
from strata.addon.core.arrays import MeshArrays
from strata.addon.devices.gpu import GpuDevice
from strata.addon.devices.gpu_meshes import GpuMeshes
from strata.addon.planning import Options
from strata.addon.scene.open import open_blend
from strata.ops.tracing import frames_table
from strata.scripts.bench.document import ROOT, milliseconds, significant, table, times, write_block
from strata.scripts.bench.real_gpu import work_of

DOCUMENT = ROOT / "docs" / "performance.md"
SCENE = ROOT / "sample_blends" / "courtyard.blend"
SIZE = (1000, 640)
REPEATS = 7


def in_window(blender: str, *words: str, trace: Path | None = None) -> dict:
    """What preview_window.py found; a copy of its trace."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.json"
        # Blender has a Python of its own, which knows nothing of ours.
        shutil.copytree(Path(strata_kernels.__file__).parent, Path(folder) / "strata_kernels")
        script = ROOT / "scripts" / "in_blender.py"
        size = map(str, SIZE)
        command = [blender, "--factory-startup", "--window-geometry", "0", "0", *size]
        command += ["--python", str(script), "--", "strata.scripts.bench.preview_window"]
        command += [str(SCENE), str(result), *words]
        if "DISPLAY" not in os.environ:
            command = ["xvfb-run", "-a", "-s", f"-screen 0 {SIZE[0]}x{SIZE[1]}x24 +extension GLX", *command]
        subprocess.run(command, check=True, timeout=1200, stdout=subprocess.DEVNULL)
        found = json.loads(result.read_text())
        if trace and (made := result.with_name("trace.json")).exists():
            shutil.copy(made, trace)
    if "failure" in found:
        raise SystemExit(found["failure"])
    return found


def window_text(found: dict, eevee: dict | None) -> str:
    """The measurements in the window, in words and a table."""
    rows = []
    for name, light in found["lights"].items():
        still = light["still"]
        sharp = next((seconds for seconds, samples, _error in still if samples >= 1), None)
        rows.append(
            [
                name,
                significant(light["rate"]),
                significant(found["solid"][name]),
                f"1/{round(1 / light['scale'])}, maps 1/{round(1 / light['map_share'])}",
                significant(light["frame_ms"], 3),
                light["nodes"],
                significant(sharp) if sharp else "",
                significant(still[-1][0]) if still else "",
            ]
        )
    others = [
        [
            f"`{name}`, {each['light']}",
            ", ".join(effect.replace("_", " ") for effect in each["effects"]),
            significant(each["rate"]),
            f"1/{round(1 / each['scale'])}",
            significant(each["frame_ms"], 3),
            significant(each["still"][0][0]),
            significant(each["still"][-1][0]),
        ]
        for name, each in found["others"].items()
    ]
    ratios = [frame / steps for frame, steps, _ran in found["slider"] if steps]
    lines = [
        f"{found['size'][0]}x{found['size'][1]} pixels without overlays and gizmos. In Solid shading Blender "
        f"alone draws {significant(found['alone'])} frames a second while nothing moves, and "
        f"{significant(found['alone dragged'])} while the sun is dragged. First frame "
        f"{significant(found['first'])} s after switching on, still picture of all samples "
        f"{significant(found['first still'][-1][0])} s later.",
        "",
        table(
            [
                "dragged light",
                "frames a second, rendered",
                "over Solid",
                "scale",
                "frame, ms",
                "nodes run",
                "first full picture, s",
                "all samples, s",
            ],
            rows,
        ),
        "",
        "Other effects, in Strata's rendered viewport:",
        "",
        table(
            [
                "scene, dragged light",
                "effects",
                "frames a second",
                "scale",
                "frame, ms",
                "first full picture, s",
                "two samples, s",
            ],
            others,
        ),
        "",
        f"A slider's change costs {times(statistics.median(ratios))} the time of the steps that it feeds.",
    ]
    if eevee:
        seconds, samples = eevee["eevee still"]
        sun = found["lights"]["Sun"]
        lines += [
            "",
            f"EEVEE's rendered viewport, same file and window: {significant(eevee['eevee rate'])} frames a "
            f"second while the sun is dragged ({times(sun['rate'] / eevee['eevee rate'])} that in Strata's "
            f"rendered viewport), and {significant(seconds)} s for its {samples} samples once it is still "
            f"({times(seconds / sun['still'][-1][0])} of Strata's time).",
        ]
    return "\n".join(lines)


def upload_text() -> str:
    """A mesh of a million triangles onto the GPU against filling textures of the same size."""
    import gpu

    side = 708
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side))
    positions = np.stack([x, y, 0.1 * np.sin(5 * x)], -1).reshape(-1, 3).astype(np.float32)
    low = np.arange(side * side).reshape(side, side)[:-1, :-1].ravel()
    corners = np.stack([low, low + 1, low + side + 1, low, low + side + 1, low + side], -1)
    corners = corners.reshape(-1).astype(np.int32)
    mesh = MeshArrays(positions, corners, np.arange(0, len(corners) + 1, 3, dtype=np.int32))
    device = GpuDevice()
    made, bare = [], []
    for _ in range(REPEATS):
        started = time.perf_counter()
        for rows in (len(positions), len(corners) // 3):
            texels = np.ones((-(-rows // 4096) * 4096, 4), np.float32)
            data = gpu.types.Buffer("FLOAT", texels.size, texels.reshape(-1))
            gpu.types.GPUTexture((4096, len(texels) // 4096), format="RGBA32F", data=data)
        device.finish()
        bare.append(time.perf_counter() - started)
        started = time.perf_counter()
        GpuMeshes(device, (mesh,))
        device.finish()
        made.append(time.perf_counter() - started)
    ratio = statistics.median(a / b for a, b in zip(made, bare, strict=True))
    return (
        f"{len(corners) // 3:,} triangles onto the GPU: {milliseconds(statistics.median(made))} ms, "
        f"{times(ratio)} of filling textures of the same size ({milliseconds(statistics.median(bare))} ms)."
    )


def real_gpu_text() -> str:
    """What a frame at full size would move and compute."""
    open_blend(SCENE)
    scene = bpy.context.scene
    on_gpu = {"soft_shadow": {"method": "bitmask"}}  # what automatic is there
    options = Options(("soft_shadow",), backend="cpu", composite=True, samples=1, probes=0, values=on_gpu)
    *read, seconds = read_scene(scene, scene.view_layers[0], options, size=SIZE)
    job = BakeJob(*read, options, read_seconds=seconds)
    job.result()  # by then it has had a closer look
    outline, graph = job.outline, job.graph
    works = list(work_of(outline, graph, graph.nodes()))
    by_step: dict[str, list] = {}
    for work in works:
        by_step.setdefault(work.step, []).append(work)
    rows = [
        [
            step,
            len(group),
            significant(sum(work.megabytes for work in group), 3),
            significant(sum(work.gigaoperations for work in group), 3),
            significant(sum(work.milliseconds for work in group), 3),
        ]
        for step, group in by_step.items()
    ]
    own = sum(w.milliseconds for w in works if w.instance.startswith("Sun") or w.step == "composite")
    whole = sum(w.milliseconds for w in works)
    moved = sum(w.milliseconds for w in works if w.step not in ("layered_depth", "soft_shadow/prepare"))
    rates = [significant(1e3 / each) for each in (own, moved, whole)]
    return "\n".join(
        [
            table(["step", "runs", "MB moved", "billion operations", "ms expected"], rows),
            "",
            f"That is {rates[0]} frames a second while the sun is dragged, {rates[1]} while the camera "
            f"moves, and {rates[2]} were everything made anew: an expectation, for a GPU that is not here.",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--eevee", action="store_true", help="also measure EEVEE's viewport: minutes")
    parser.add_argument("--no-window", action="store_true", help="only what needs no window")
    parser.add_argument("--trace", type=Path, metavar="TRACE.json", help="trace drags, and nothing else")
    arguments = parser.parse_args()
    if arguments.trace:
        in_window(os.environ["BLENDER"], "trace", trace=arguments.trace)
        print("\n".join(frames_table(json.loads(arguments.trace.read_text())["otherData"])))
        return
    if not arguments.no_window:
        blender = os.environ["BLENDER"]
        found = in_window(blender)
        eevee = in_window(blender, "eevee") if arguments.eevee else None
        write_block(DOCUMENT, "preview", window_text(found, eevee))
    write_block(DOCUMENT, "upload", upload_text())
    write_block(DOCUMENT, "real gpu", real_gpu_text())


if __name__ == "__main__":
    main()
