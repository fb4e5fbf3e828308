"""What surfaces and volumes of a random scene may be made of."""

from __future__ import annotations

import bpy
import numpy as np
from strata.tests.bake.random_things import INF, NAN


def _nodes(name: str):
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    return material, tree, tree.nodes.get("Principled BSDF"), tree.nodes.get("Material Output")


def _principled(**values) -> bpy.types.Material:
    material, _tree, node, _output = _nodes("principled")
    for name, value in values.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return material


def _image(kind: str) -> bpy.types.Image:
    if kind == "missing":
        image = bpy.data.images.new("missing", 4, 4)
        image.source, image.filepath = "FILE", "//not_there.png"
        return image
    image = bpy.data.images.new(kind, 8, 8, alpha=True, float_buffer=kind == "wild")
    pixels = np.random.default_rng(1).random(8 * 8 * 4, np.float32)
    if kind == "wild":
        pixels[:12] = [NAN, INF, -INF, 1e38, -1e38, 1e-38, NAN, NAN, NAN, NAN, INF, 0.0]
    image.pixels.foreach_set(pixels)
    image.pack()
    return image


def _textured(kind: str, *inputs: str, compared: bool = False) -> bpy.types.Material:
    material, tree, node, _output = _nodes(kind)
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = _image(kind)
    for name in inputs:
        source = texture.outputs["Alpha" if name == "Alpha" else "Color"]
        if compared:
            math_node = tree.nodes.new("ShaderNodeMath")
            math_node.operation = "GREATER_THAN"
            tree.links.new(source, math_node.inputs[0])
            source = math_node.outputs[0]
        tree.links.new(source, node.inputs[name])
    return material


def _medium(kind: str, density: float, anisotropy: float = 0.0) -> bpy.types.Material:
    material, tree, node, output = _nodes("medium")
    tree.nodes.remove(node)
    add_volume(tree, output, kind, density, anisotropy)
    return material


def add_volume(tree, output, kind: str, density: float, anisotropy: float) -> None:
    volume = tree.nodes.new(kind)
    volume.inputs["Density"].default_value = density
    if "Anisotropy" in volume.inputs:
        volume.inputs["Anisotropy"].default_value = anisotropy
    tree.links.new(volume.outputs[0], output.inputs["Volume"])


def _other_surface(kind: str) -> bpy.types.Material:
    material, tree, node, output = _nodes(kind)
    tree.nodes.remove(node)
    if kind:
        tree.links.new(tree.nodes.new(kind).outputs[0], output.inputs["Surface"])
    return material


def _without_output() -> bpy.types.Material:
    material, tree, _node, _output = _nodes("without output")
    tree.nodes.clear()
    return material


MATERIALS = {
    "plain": _principled,
    "red": lambda: _principled(Base_Color=(0.8, 0.1, 0.1, 1.0)),
    "clear": lambda: _principled(Alpha=0.3),
    "away": lambda: _principled(Alpha=0.0),
    "glowing": lambda: _principled(Emission_Strength=5.0),
    "blazing": lambda: _principled(Emission_Strength=3e38, Emission_Color=(3e38, 1, 1, 1)),
    "black hole": lambda: _principled(Base_Color=(-1.0, 1e30, 0, 1)),
    "diffuse": lambda: _other_surface("ShaderNodeBsdfDiffuse"),
    "emission": lambda: _other_surface("ShaderNodeEmission"),
    "transparent": lambda: _other_surface("ShaderNodeBsdfTransparent"),
    "glass": lambda: _other_surface("ShaderNodeBsdfGlass"),
    "mixed": lambda: _other_surface("ShaderNodeMixShader"),
    "no shader": lambda: _other_surface(""),
    "no output": _without_output,
    "leaves": lambda: _textured("leaves", "Base Color", "Alpha"),
    "cut": lambda: _textured("leaves", "Alpha", compared=True),
    "wild": lambda: _textured("wild", "Base Color", "Alpha"),
    "missing": lambda: _textured("missing", "Base Color", "Alpha"),
    "mist": lambda: _medium("ShaderNodeVolumeScatter", 0.3),
    "thick": lambda: _medium("ShaderNodeVolumeScatter", 1e4, 0.9),
    "soot": lambda: _medium("ShaderNodeVolumeAbsorption", 2.0),
    "smoke": lambda: _medium("ShaderNodeVolumePrincipled", 1.0, -0.5),
    "no mist": lambda: _medium("ShaderNodeVolumeScatter", 0.0),
    "negative": lambda: _medium("ShaderNodeVolumeScatter", -1.0),
}
