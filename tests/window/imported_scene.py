"""A scene as it comes out of a download: `python -m strata.tests.window.imported_scene FOLDER` writes
imported.blend, and the library and pictures that it links. It has subdivision, leaves cut out of cards by
alpha, glass, hair, an instanced collection of another file, and a picture of the sky for a world."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

LAMPS = ("Key", "Sun")


def write(folder: Path) -> Path:
    library = _write_library(folder / "props.blend")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 320, 180
    _world(folder / "sky.exr")
    _ground_and_head()
    _leaves()
    _linked(library)
    _lamps()
    camera = _added("Camera", bpy.data.cameras.new("Camera"), (0.0, -7.0, 2.6))
    camera.rotation_euler = (1.32, 0.0, 0.0)
    scene.camera = camera
    path = folder / "imported.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def _added(name: str, data, place=(0.0, 0.0, 0.0)) -> bpy.types.Object:
    thing = bpy.data.objects.new(name, data)
    thing.location = place
    bpy.context.scene.collection.objects.link(thing)
    return thing


def _material(name: str, **inputs) -> tuple[bpy.types.Material, bpy.types.Node]:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    for words, value in inputs.items():
        shader.inputs[words.replace("_", " ")].default_value = value
    return material, shader


def _write_library(path: Path) -> Path:
    """A collection with a pot, and a lamp of its own."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    group = bpy.data.collections.new("Pot")
    bpy.context.scene.collection.children.link(group)
    bpy.ops.mesh.primitive_cylinder_add(vertices=24, radius=0.3, depth=0.5, location=(0.0, 0.0, 0.25))
    pot = bpy.context.object
    pot.data.materials.append(_material("Clay", Base_Color=(0.6, 0.25, 0.15, 1.0))[0])
    for collection in list(pot.users_collection):
        collection.objects.unlink(pot)
    group.objects.link(pot)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def _linked(library: Path) -> None:
    with bpy.data.libraries.load(str(library), link=True) as (_, into):
        into.collections = ["Pot"]
    for number, place in enumerate(((-1.9, -0.6, 0.0), (2.1, 0.2, 0.0))):
        empty = _added(f"Pot {number}", None, place)
        empty.instance_type, empty.instance_collection = "COLLECTION", into.collections[0]


def _world(path: Path) -> None:
    """Blue above, warm below, and a bright spot."""
    sky = bpy.data.images.new("sky", 64, 32, float_buffer=True)
    up = np.linspace(-1.0, 1.0, 32)[:, None, None]
    rgba = np.where(up > 0.0, (0.3, 0.5, 0.9, 1.0), (0.25, 0.2, 0.15, 1.0)) * np.ones((32, 64, 1))
    rgba[24:27, 10:13, :3] = 40.0
    sky.pixels.foreach_set(rgba.astype(np.float32).ravel())
    sky.filepath_raw, sky.file_format = str(path), "OPEN_EXR"
    sky.save()
    world = bpy.data.worlds.new("Sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = sky
    background = next(node for node in nodes if node.type == "BACKGROUND")
    links.new(texture.outputs["Color"], background.inputs["Color"])


def _ground_and_head() -> None:
    bpy.ops.mesh.primitive_plane_add(size=14.0)
    bpy.context.object.name = "Ground"
    bpy.ops.mesh.primitive_monkey_add(size=2.0, location=(0.0, 0.0, 1.2))
    head = bpy.context.object
    head.name = "Head"
    head.data.materials.append(_material("Skin", Base_Color=(0.8, 0.5, 0.4, 1.0))[0])
    subdivision = head.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels, subdivision.render_levels = 1, 2
    head.modifiers.new("Hair", "PARTICLE_SYSTEM")
    hair = head.particle_systems[0].settings
    hair.type, hair.count, hair.hair_length = "HAIR", 60, 0.4
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.5, location=(-1.3, -1.6, 0.5))
    bpy.context.object.name = "Ball"
    glass, _ = _material("Glass", Transmission_Weight=1.0, Roughness=0.0)
    bpy.context.object.data.materials.append(glass)


def _leaves() -> None:
    """Cards in all directions, of which a picture's alpha leaves a disk."""
    size = 32
    y, x = np.mgrid[:size, :size] / (size - 1.0) * 2.0 - 1.0
    rgba = np.ones((size, size, 4), np.float32) * (0.1, 0.4, 0.1, 1.0)
    rgba[..., 3] = np.hypot(x, y) < 0.8
    picture = bpy.data.images.new("leaf", size, size, alpha=True)
    picture.pixels.foreach_set(rgba.astype(np.float32).ravel())
    picture.pack()
    material, shader = _material("Leaf")
    texture = material.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = picture
    material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    material.node_tree.links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])
    mesh = bpy.data.meshes.new("Leaf")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    uvs = mesh.uv_layers.new()
    uvs.data.foreach_set("uv", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))
    mesh.materials.append(material)
    random = np.random.default_rng(1)
    for number in range(40):
        leaf = _added(f"Leaf {number}", mesh)
        place = np.array((1.6, 1.2, 1.9)) + random.normal(size=3) * 0.5
        turn = Matrix.Rotation(random.uniform(0.0, 6.0), 4, random.normal(size=3))
        leaf.matrix_world = Matrix.Translation(place) @ turn @ Matrix.Scale(0.2, 4)


def _lamps() -> None:
    key = bpy.data.lights.new("Key", "AREA")
    key.energy, key.size = 300.0, 1.0
    _added("Key", key, (-2.5, -2.5, 4.0)).rotation_euler = (0.6, -0.5, 0.0)
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = 2.0, 0.02
    _added("Sun", sun, (3.0, -2.0, 6.0)).rotation_euler = (0.5, 0.5, 0.0)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
