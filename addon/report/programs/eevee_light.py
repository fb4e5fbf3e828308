"""Renders each lamp by itself: `eevee_light.py REQUEST.json`, written by rivals/eevee.py. A program of
its own, run by a Blender of its own as the audit's is, which it takes its ways with a scene from. Writes one
OpenEXR file a render and lamp, `<number>_<group>.exr`, not compressed, and `costs.json`."""

import json
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path


def main(path: str) -> None:
    request = json.loads(Path(path).read_text(encoding="utf-8"))
    audit, lamp_light = loaded("audit", request["audit"]), loaded("lamp_light", request["lamp_light"])
    scene, view_layer = audit.opened(request)
    audit.only(scene, view_layer, "surface", request["media"])
    view_layer.use_pass_diffuse_direct = view_layer.use_pass_diffuse_color = False
    set_up(scene, request["filter"]["width"])
    lamps, black = lamp_light.put_into_groups(view_layer, request["groups"])
    while view_layer.lightgroups:  # EEVEE has none
        view_layer.lightgroups.remove(view_layer.lightgroups[0])
    data = {lamp.name_full: lamp.data for lamp in lamps}
    for light in data.values():
        light.specular_factor, light.transmission_factor, light.volume_factor = 0.0, 0.0, 0.0
        light.use_shadow_jitter = True  # its soft shadows at their best
    folder, costs = Path(request["folder"]), []
    for number, render in enumerate(request["renders"]):
        scene.eevee.taa_render_samples = render["samples"]
        parts = []
        for lamp in lamps:
            for each in lamps:
                each.data = data[each.name_full] if each == lamp else black
            lamp.data.use_shadow = render["shadow"]
            scene.render.filepath = str(folder / f"{number}_{request['groups'][lamp.name_full]}.exr")
            parts.append(lamp_light.rendered(scene, writes=True))
        memory = [each["memory_mb"] for each in parts]
        total = {name: sum(each[name] for each in parts) for name in ("wall", "cpu")}
        costs.append(total | {"memory_mb": None if None in memory else max(memory)})
    (folder / "costs.json").write_text(json.dumps(costs), encoding="utf-8")


def set_up(scene, filter_width: float) -> None:
    """Light goes straight from a lamp to a surface, however far."""
    scene.render.engine = "BLENDER_EEVEE"
    scene.render.filter_size = filter_width
    values = {
        "use_shadows": True,
        "use_raytracing": False,
        "use_fast_gi": False,
        "light_threshold": 1e-6,  # it takes 0 for no reach at all
        "clamp_surface_direct": 0.0,
        "shadow_resolution_scale": 1.0,
        "use_overscan": False,
    }
    for name, value in values.items():
        setattr(scene.eevee, name, value)


def loaded(name: str, path: str):
    spec = spec_from_file_location(name, path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    main(sys.argv[-1])
