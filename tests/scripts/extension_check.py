"""Inside a Blender that knows nothing of Strata: install the zip, enable, bake, disable, look for remains.

`python scripts/in_blender.py -- strata.tests.scripts.extension_check ZIP SCENE.blend OUT.exr` with the
pip-installed Blender, or `blender -b --factory-startup --python scripts/in_blender.py -- ...` alike.
BLENDER_USER_RESOURCES has to name an empty folder.
"""

import gc
import importlib
import os
import sys
import threading
import traceback
from importlib.util import find_spec
from pathlib import Path

import bpy
import numpy as np
from bpy.utils import previews
from strata.tests.support.gpu_objects import GpuObjects

MODULE = "bl_ext.user_default.strata"
ROUNDS = 20
MOST_GROWN_MB = 8.0  # over fifteen rounds; modules that were kept would be about 3 MB a round


def registered() -> dict[str, list[str]]:
    """Everything that an extension could leave behind and that Blender lets Python see."""
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    lists = {name: functions for name, functions in lists.items() if isinstance(functions, list)}
    keyconfig = bpy.context.window_manager.keyconfigs.addon
    keymaps = keyconfig.keymaps if keyconfig else ()
    return {
        "classes": sorted(dir(bpy.types)),
        "handlers": sorted(f"{name}: {f.__module__}.{f.__name__}" for name in lists for f in lists[name]),
        "scene properties": sorted(bpy.types.Scene.bl_rna.properties.keys()),
        "operators": sorted(dir(bpy.ops)),
        "keymap items": sorted(
            f"{keymap.name} {i.idname}" for keymap in keymaps for i in keymap.keymap_items
        ),
        "menus": sorted(str(f) for f in getattr(bpy.types.TOPBAR_MT_render.draw, "_draw_funcs", ())),
        "paths": sorted(path for path in sys.path if "strata" in path),
        "light properties": sorted(bpy.types.Light.bl_rna.properties.keys()),
        "preset paths": sorted(path for path in bpy.utils._preset_path_registry if "strata" in path),
        "panels of others that the engine shows": sorted(  # its own are among the classes
            panel.__name__
            for panel in bpy.types.Panel.__subclasses__()
            if "STRATA" in getattr(panel, "COMPAT_ENGINES", ()) and not panel.__name__.startswith("STRATA_")
        ),
        "picture collections": [str(size) for size in (len(previews._uuid_open),) if size],
        "threads": sorted(t.name for t in threading.enumerate() if t.name.startswith("strata")),
    }


def strata_subclasses() -> list[str]:
    """Classes that are registered still, also those that bpy.types does not list."""
    found = []
    for base in (bpy.types.PropertyGroup, bpy.types.Panel, bpy.types.Operator, bpy.types.RenderEngine):
        found += [
            cls.__name__ for cls in base.__subclasses__() if cls.is_registered and MODULE in cls.__module__
        ]
    return found


def resident_mb() -> float:
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def start_gpu():
    """A GPU device of the extension, or None where there is no GPU and none is expected."""
    devices = importlib.import_module(f"{MODULE}.addon.devices.gpu")
    try:
        return devices.GpuDevice()
    except devices.DeviceUnavailable:
        if os.environ.get("STRATA_EXPECT_GPU") == "1":
            raise
        print("no GPU here")
        return None


def check_gpu_is_left(scene) -> None:
    """A bake on the GPU, which keeps some for the next one; then off, and nothing of it is held any more."""
    import addon_utils

    if start_gpu() is None:
        return
    with GpuObjects() as objects:
        scene.strata.backend = "gpu"
        assert bpy.ops.strata.bake() == {"FINISHED"}
        scene.strata.backend = "cpu"
        assert objects.made > 50, f"only {objects.made} objects on the GPU: did the bake run there?"
        assert objects.held(), "nothing is kept for the next bake"
        addon_utils.disable(MODULE)
        assert not objects.held(), objects.held()
        print(f"{objects.made} GPU objects made, none left")
    assert addon_utils.enable(MODULE) is not None


def check_many_rounds(before: dict[str, list[str]]) -> None:
    """Disabling and enabling, as Blender's Reload Scripts does it, keeps nothing and needs no more memory,
    though there is something on the GPU each time."""
    import addon_utils

    settled = 0.0
    for number in range(ROUNDS):
        if device := start_gpu():
            device.constant("check", lambda device=device: device.upload(np.ones((512, 1024), np.float32)))
            device.finish()
        addon_utils.disable(MODULE)
        assert registered() == before, f"round {number}"
        assert not strata_subclasses(), strata_subclasses()
        for name in [name for name in sys.modules if name.startswith(MODULE)]:
            del sys.modules[name]
        assert addon_utils.enable(MODULE) is not None
        gc.collect()
        if number == ROUNDS // 4:  # the first ones fill caches of Python and Blender
            settled = resident_mb()
    grown = resident_mb() - settled
    print(f"{ROUNDS} rounds, {grown:.1f} MB more")
    assert grown < MOST_GROWN_MB


def check(archive: str, scene: str, output: str) -> None:
    import addon_utils  # Blender's own, found once bpy is there

    for name in [name for name in sys.modules if name.partition(".")[0] == "strata"]:
        del sys.modules[name]  # which found this file; from here on there is nothing but the zip
    for name in ("strata", "strata_kernels"):
        assert find_spec(name) is None, f"{name} is there already, so the zip's own would not be proved"
    before = registered()

    bpy.ops.extensions.package_install_files(
        repo="user_default", filepath=archive, enable_on_install=True, overwrite=True
    )
    assert MODULE in bpy.context.preferences.addons, "not enabled"
    assert bpy.utils.preset_find("Draft", "strata/soft_shadow"), "no presets are listed"
    print("installed and enabled")

    bpy.ops.wm.open_mainfile(filepath=scene)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 96, 54, 100
    settings = bpy.context.scene.strata
    settings.backend, settings.samples, settings.probes = "cpu", 1, 64
    settings.save_to = "IMAGES"
    images = set(bpy.data.images)
    assert bpy.ops.strata.plan() == {"FINISHED"}
    assert bpy.ops.strata.bake(filepath=output) == {"FINISHED"}
    made = [image for image in bpy.data.images if image not in images and image.is_float]
    assert made, "no image was made"
    own = bpy.context.preferences.addons[MODULE].preferences
    own.backend, settings.backend = "cpu", "preferences"
    options_of = importlib.import_module(f"{MODULE}.addon.ui.properties").options_of
    assert options_of(bpy.context.scene).backend == "cpu", "scenes do not take the device of the preferences"
    assert bpy.ops.strata.documentation.poll(), "there is no documentation to open"
    own.backend, settings.backend = "auto", "cpu"
    import strata_kernels

    home = os.path.realpath(os.environ["BLENDER_USER_RESOURCES"])
    place = os.path.realpath(strata_kernels.__file__)
    assert place.startswith(home), f"{place} is not the zip's"
    print(f"baked {len(made)} layers with Python {sys.version.split()[0]}")

    warnings = addon_utils._extensions_warnings_get()
    assert not warnings, warnings
    for _ in range(2):  # a second round finds what the first left half undone
        addon_utils.disable(MODULE)
        after = registered()
        for kind, names in before.items():
            assert names == after[kind], f"{kind}: {sorted(set(names) ^ set(after[kind]))}"
        assert not strata_subclasses(), strata_subclasses()
        assert addon_utils.enable(MODULE) is not None
        assert hasattr(bpy.context.scene, "strata")
        sys.modules[MODULE].register()  # twice in a row changes nothing
    check_gpu_is_left(bpy.context.scene)
    check_many_rounds(before)
    addon_utils.disable(MODULE)
    sys.modules[MODULE].unregister()
    assert registered() == before
    print("disabled, nothing left")


if __name__ == "__main__":
    words = sys.argv[sys.argv.index("--") + 1 :]
    try:
        check(*(str(Path(word).resolve()) for word in words))
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)  # Blender's own exit code would be 0
