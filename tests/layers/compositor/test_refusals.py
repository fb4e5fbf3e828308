"""What the compositor's button refuses, with nothing changed, and what it warns of."""

from __future__ import annotations

import bpy
import OpenEXR
import pytest
from strata.addon.layers import shadow_nodes
from strata.addon.layers.exr_header import header_of
from strata.tests.layers.compositor.scene import SIZE, FlatEngine, built, everything, lamps, refused


def test_renders_that_cannot_have_it_are_refused_before_the_press(scene):
    for engine in ("STRATA", "BLENDER_EEVEE", "BLENDER_WORKBENCH"):
        scene.render.engine = engine
        assert not bpy.ops.strata.build_compositor.poll(), engine
    scene.render.engine = "FLAT"
    assert bpy.ops.strata.build_compositor.poll()
    scene.render.use_multiview = True
    assert not bpy.ops.strata.build_compositor.poll()


def larger(scene):
    scene.render.resolution_percentage = 200


def cropped(scene):
    scene.render.use_border = scene.render.use_crop_to_border = True
    scene.render.border_max_x = 0.5


def other_camera(scene):
    scene.camera = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))


def other_view_layer(scene):
    scene.view_layers.new("Second")


def no_view_layer(scene):
    bpy.context.view_layer.use = False


def nowhere(scene):
    scene.strata.output = "//none.exr"


def no_exr(scene):
    scene.strata.output = "//scene.blend"


def tree_of_a_user(scene) -> bpy.types.NodeTree:
    """With nothing but a way out."""
    tree = bpy.data.node_groups.new("Mine", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.nodes.new("NodeGroupOutput")
    scene.compositing_node_group = tree
    return tree


def render_layers_in_a_group(scene):
    inner = bpy.data.node_groups.new("Inner", "CompositorNodeTree")
    inner.nodes.new("CompositorNodeRLayers")
    tree_of_a_user(scene).nodes.new("CompositorNodeGroup").node_tree = inner


def linked_nodes(scene):
    bpy.data.libraries.write(path := bpy.path.abspath("//nodes.blend"), {tree_of_a_user(scene)})
    with bpy.data.libraries.load(path, link=True) as (_, taken):
        taken.node_groups = ["Mine"]
    (scene.compositing_node_group,) = taken.node_groups


def only_the_noisy_image(scene):
    tree, FlatEngine.is_denoised = tree_of_a_user(scene), True
    layers, denoise = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeDenoise")
    bpy.context.view_layer.update_render_passes()
    tree.links.new(layers.outputs["Noisy Image"], denoise.inputs["Image"])
    tree.links.new(denoise.outputs["Image"], tree.nodes["Group Output"].inputs[0])
    tree.links.new(layers.outputs["Image"], tree.nodes.new("CompositorNodeViewer").inputs["Image"])


def only_alpha(scene):
    tree = tree_of_a_user(scene)
    layers = tree.nodes.new("CompositorNodeRLayers")
    tree.links.new(layers.outputs["Alpha"], tree.nodes["Group Output"].inputs[0])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (nowhere, "none.exr: bake to a file first"),
        (no_exr, "There is no"),
        (larger, "The file has 32 x 18 pixels and the render 64 x 36: bake again"),
        (cropped, "The render is cropped to its region and the file is not: bake again"),
        (other_camera, "and the scene renders from 'Other': bake again"),
        (other_view_layer, "view layer 'Second' renders too and has no shadow of it: bake that as well"),
        (no_view_layer, "no view layer renders"),
        (
            tree_of_a_user,
            "the compositor has no Render Layers node of view layer 'ViewLayer' at its top level",
        ),
        (render_layers_in_a_group, "no Render Layers node of view layer 'ViewLayer' at its top level"),
        (linked_nodes, "the compositor's nodes 'Mine' are linked from a library and cannot be changed"),
        (only_the_noisy_image, "for view layer 'ViewLayer' nothing does, only Noisy Image: use Image"),
        (only_alpha, "for view layer 'ViewLayer' nothing does: use Image"),
    ],
)
def test_a_file_that_does_not_fit_is_refused_and_nothing_changes(scene, change, reason):
    change(scene)
    before = everything(scene)
    assert reason in refused()
    assert everything(scene) == before


def test_an_engine_without_light_groups_is_refused_and_nothing_changes(scene):
    FlatEngine.has_groups = False
    bpy.context.view_layer.update_render_passes()
    before = everything(scene)
    assert "FLAT renders no light groups" in refused()
    assert everything(scene) == before


def test_whatever_fails_leaves_each_lamp_a_shadow(scene, monkeypatch):
    def fails(*_):
        raise MemoryError

    monkeypatch.setattr(shadow_nodes, "_fill", fails)
    assert "not enough memory" in refused()
    assert all(lamp.data.use_shadow for lamp in lamps(scene).values())
    assert not any(lamp.data.strata_shadow_composited for lamp in lamps(scene).values())
    assert not bpy.context.view_layer.lightgroups


def test_a_file_of_a_render_region_does_not_do_for_more(scene, tmp_path):
    render = scene.render
    scene.strata.output = str(tmp_path / "part.exr")
    render.use_border, render.border_max_x = True, 0.5
    bpy.ops.strata.bake()
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    render.border_max_x = 0.25
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    for wider in (True, False):
        render.use_border, render.border_max_x = wider, 0.75
        assert "The file has shadows in its render region only, and the render is larger" in refused()
    render.use_border, render.border_max_x, scene.strata.exr.window = True, 0.5, "region"
    bpy.ops.strata.bake()
    assert "which Blender's compositor misplaces: bake with Window set to Frame" in refused()
    scene.strata.exr.window, render.use_crop_to_border = "frame", True
    bpy.ops.strata.bake()
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    render.border_min_x, render.border_max_x = 0.25, 0.75
    assert "The file is cropped to another region than the render" in refused()
    render.use_crop_to_border = False
    assert "The file is cropped to a render region and the render is not" in refused()


def test_what_layers_do_not_know_is_warned_of(scene, capfd):
    blurs = ("Motion blur is on: ", "Camera 'Camera' has depth of field: ")
    assert not any(line.startswith(blurs) for line in built(capfd))
    scene.render.use_motion_blur = True
    scene.camera.data.dof.use_dof = True
    told = built(capfd)
    assert "Motion blur is on: layers show one instant and do not fit what moves" in told
    assert "Camera 'Camera' has depth of field: layers are sharp and do not fit what it blurs" in told


def volume(owner) -> None:
    tree = owner.node_tree
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    output = tree.get_output_node("CYCLES")
    for link in list(output.inputs["Surface"].links):
        tree.links.remove(link)
    tree.links.new(scatter.outputs[0], output.inputs["Volume"])


def test_media_whose_light_gets_the_wrong_shadow_are_warned_of(scene, capfd):
    wrong = " is a medium: light that it scatters gets the shadow of what lies behind it"
    assert not any(wrong in line for line in built(capfd))
    material = bpy.data.materials.new("Haze")
    haze = bpy.data.objects.new("Haze", bpy.data.meshes.new("Haze"))
    haze.data.materials.append(material)
    scene.collection.objects.link(haze)
    assert not any(wrong in line for line in built(capfd))
    volume(material)
    assert sum(line.startswith(f"'Haze'{wrong}") for line in built(capfd)) == 1
    haze.hide_render = True
    assert not any(wrong in line for line in built(capfd))
    scene.world = scene.world or bpy.data.worlds.new("World")
    volume(scene.world)
    assert sum(line.startswith(f"World '{scene.world.name}'{wrong}") for line in built(capfd)) == 1


@pytest.mark.parametrize(
    "content", [b"", b"BLENDER17-01v0502", b"\x76\x2f\x31\x01\x02\x04\x00\x00channels\x00chlist"]
)
def test_what_is_no_exr_file_is_said(scene, tmp_path, content):
    scene.strata.output = str(tmp_path / "broken.exr")
    (tmp_path / "broken.exr").write_bytes(content)
    assert "broken.exr is no OpenEXR file" in refused()


def test_a_header_is_read_as_openexr_reads_it(courtyard):
    found = header_of(courtyard / "baked.exr")
    with OpenEXR.File(str(courtyard / "baked.exr"), separate_channels=True) as file:
        assert len(found.parts) == len(file.parts)
        for part, theirs in zip(found.parts, file.parts, strict=True):
            header = theirs.header
            assert part.channels == tuple(sorted(theirs.channels))
            for ours, name in ((part.data_window, "dataWindow"), (part.display_window, "displayWindow")):
                assert ours == tuple(int(n) for corner in header[name] for n in corner)
            texts = {
                name: value for name, value in header.items() if isinstance(value, str) and name != "name"
            }
            assert {name: part.texts[name] for name in texts} == texts
    assert found.size == SIZE
