"""Random surfaces, as people wire them: what makes them clear is a constant, an image, an attribute, a side
or a ray, through nodes that calculate."""

from __future__ import annotations

import random

import bpy
import numpy as np

MATHS = ("MULTIPLY", "ADD", "SUBTRACT", "POWER", "MINIMUM", "MAXIMUM", "GREATER_THAN", "LESS_THAN", "ROUND")
BLENDS = ("MIX", "MULTIPLY", "SCREEN", "ADD", "LIGHTEN", "DARKEN")
ATTRIBUTE = "Painted"


class RandomMaterial:
    """Of one seed's `chance`; `unreadable`: something in it that no one reads but a renderer."""

    def __init__(self, chance: random.Random, unreadable: bool = False):
        self.chance, self.unreadable = chance, unreadable
        self.material = bpy.data.materials.new("Random")
        self.tree = self.material.node_tree
        self.tree.nodes.clear()
        output = self._node("ShaderNodeOutputMaterial")
        self._link(self._surface(), output.inputs["Surface"])

    def displace(self, scale: float) -> None:
        """Moves vertices by an image, in metres."""
        (output,) = (node for node in self.tree.nodes if node.type == "OUTPUT_MATERIAL")
        node = self._node("ShaderNodeDisplacement")
        node.inputs["Scale"].default_value = scale
        self._link(self._image().outputs["Color"], node.inputs["Height"])
        self._link(node.outputs[0], output.inputs["Displacement"])
        self.material.displacement_method = "DISPLACEMENT"

    def _node(self, kind: str, tree=None, **values):
        node = (tree or self.tree).nodes.new(kind)
        for name, value in values.items():
            setattr(node, name, value)
        return node

    def _link(self, source, target) -> None:
        self.tree.links.new(source, target)

    def _colour(self) -> tuple[float, ...]:
        return *(self.chance.uniform(0.1, 0.9) for _ in range(3)), 1.0

    def _surface(self):
        kind = self.chance.choice(("principled", "mix", "mix", "plain", "group"))
        opacity = self._value()
        if kind == "principled":
            node = self._node("ShaderNodeBsdfPrincipled")
            self._link(opacity, node.inputs["Alpha"])
            if self.chance.random() < 0.5:
                self._link(self._image().outputs["Color"], node.inputs["Base Color"])
            else:
                node.inputs["Base Color"].default_value = self._colour()
            return node.outputs[0]
        body = self._node("ShaderNodeBsdfDiffuse")
        body.inputs["Color"].default_value = self._colour()
        if kind == "plain" and not self.unreadable:
            return body.outputs[0]
        clear = self._node("ShaderNodeBsdfTransparent")
        if kind != "group":
            mix = self._node("ShaderNodeMixShader")
            self._link(opacity, mix.inputs[0])
            self._link(clear.outputs[0], mix.inputs[1])
            self._link(body.outputs[0], mix.inputs[2])
            return mix.outputs[0]
        return self._in_group(opacity, clear.outputs[0], body.outputs[0])

    def _in_group(self, opacity, clear, body):
        """The same mixing inside a node group, whose factor is an input of its own."""
        group = bpy.data.node_groups.new("Mixing", "ShaderNodeTree")
        for name, kind in (
            ("Opacity", "NodeSocketFloat"),
            ("Clear", "NodeSocketShader"),
            ("Body", "NodeSocketShader"),
        ):
            group.interface.new_socket(name, in_out="INPUT", socket_type=kind)
        group.interface.new_socket("Surface", in_out="OUTPUT", socket_type="NodeSocketShader")
        inside, outside = (self._node(f"NodeGroup{way}", group) for way in ("Input", "Output"))
        mix = self._node("ShaderNodeMixShader", group)
        for index in range(3):
            group.links.new(inside.outputs[index], mix.inputs[index])
        group.links.new(mix.outputs[0], outside.inputs[0])
        node = self._node("ShaderNodeGroup", node_tree=group)
        for source, target in zip((opacity, clear, body), node.inputs, strict=False):
            self._link(source, target)
        return node.outputs[0]

    def _value(self, depth: int = 0):
        """A number that says how opaque it is."""
        if self.unreadable and depth == 0:
            return self._node("ShaderNodeTexVoronoi").outputs["Distance"]
        if depth < 2 and self.chance.random() < 0.6:
            return self._calculated(depth)
        kind = self.chance.choice(
            ("value", "image", "alpha", "attribute", "backfacing", "path", "value", "alpha")
        )
        if kind == "value":
            node = self._node("ShaderNodeValue")
            node.outputs[0].default_value = self.chance.choice((0.0, 0.3, 0.49, 0.7, 1.0))
            return node.outputs[0]
        if kind == "attribute":
            return self._node("ShaderNodeVertexColor", layer_name=ATTRIBUTE).outputs["Alpha"]
        if kind == "backfacing":
            return self._node("ShaderNodeNewGeometry").outputs["Backfacing"]
        if kind == "path":
            name = self.chance.choice(("Is Camera Ray", "Is Shadow Ray"))
            return self._node("ShaderNodeLightPath").outputs[name]
        return self._image().outputs["Alpha" if kind == "alpha" else "Color"]

    def _calculated(self, depth: int):
        kind = self.chance.choice(("math", "math", "ramp", "range", "invert", "mix", "clamp"))
        if kind == "math":
            node = self._node("ShaderNodeMath", operation=self.chance.choice(MATHS), use_clamp=True)
            node.inputs[1].default_value = self.chance.uniform(0.2, 0.8)
            self._link(self._value(depth + 1), node.inputs[0])
            return node.outputs[0]
        if kind == "ramp":
            node = self._node("ShaderNodeValToRGB")
            node.color_ramp.elements[0].position = self.chance.uniform(0.0, 0.4)
            node.color_ramp.elements[1].position = self.chance.uniform(0.5, 1.0)
            node.color_ramp.interpolation = self.chance.choice(("LINEAR", "EASE", "CONSTANT"))
            self._link(self._value(depth + 1), node.inputs[0])
            return node.outputs[0]
        if kind == "range":
            node = self._node("ShaderNodeMapRange")
            node.inputs["To Min"].default_value = self.chance.uniform(0.0, 1.0)
            node.inputs["To Max"].default_value = self.chance.uniform(0.0, 1.0)
            self._link(self._value(depth + 1), node.inputs["Value"])
            return node.outputs[0]
        if kind == "invert":
            node = self._node("ShaderNodeInvert")
            self._link(self._value(depth + 1), node.inputs["Color"])
            return node.outputs[0]
        if kind == "mix":
            node = self._node("ShaderNodeMix", data_type="RGBA", blend_type=self.chance.choice(BLENDS))
            node.inputs[0].default_value = self.chance.uniform(0.2, 1.0)
            self._link(self._value(depth + 1), node.inputs[6])
            node.inputs[7].default_value = self._colour()
            return node.outputs[2]
        node = self._node("ShaderNodeClamp")
        node.inputs["Max"].default_value = self.chance.uniform(0.4, 1.0)
        self._link(self._value(depth + 1), node.inputs["Value"])
        return node.outputs[0]

    def _image(self):
        node = self._node("ShaderNodeTexImage", image=_spots(self.chance.randrange(1 << 16)))
        if self.chance.random() < 0.4:
            mapping = self._node("ShaderNodeMapping")
            mapping.inputs["Scale"].default_value[:2] = self.chance.choice(((2.0, 2.0), (1.0, 3.0)))
            mapping.inputs["Location"].default_value[0] = self.chance.uniform(0.0, 1.0)
            self._link(self._node("ShaderNodeTexCoord").outputs["UV"], mapping.inputs[0])
            self._link(mapping.outputs[0], node.inputs[0])
        return node


def _spots(seed: int) -> bpy.types.Image:
    """Disks with soft rims, in colour and in alpha."""
    rng, side = np.random.default_rng(seed), 64
    y, x = (np.mgrid[:side, :side] + 0.5) / side
    pixels = np.ones((side, side, 4), np.float32)
    pixels[..., :3] = rng.uniform(0.2, 1.0, 3)
    alpha = np.zeros((side, side))
    for _ in range(4):
        place, radius = rng.random(2), rng.uniform(0.1, 0.3)
        away = np.hypot(
            *(np.abs((axis - p + 0.5) % 1.0 - 0.5) for axis, p in zip((x, y), place, strict=True))
        )
        alpha = np.maximum(alpha, np.clip((radius - away) * 30.0 + 0.5, 0.0, 1.0))
    pixels[..., 3] = alpha
    pixels[..., :3] *= (0.3 + 0.7 * alpha)[..., None]
    image = bpy.data.images.new("Spots", side, side, alpha=True)
    image.alpha_mode = "CHANNEL_PACKED"
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image


def paint(mesh: bpy.types.Mesh, chance: random.Random) -> None:
    """A colour attribute, whose alpha differs from corner to corner."""
    attribute = mesh.color_attributes.new(ATTRIBUTE, "FLOAT_COLOR", "CORNER")
    colours = [chance.random() for _ in range(4 * len(mesh.loops))]
    attribute.data.foreach_set("color", colours)
