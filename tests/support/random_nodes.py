"""Random node trees of nodes that compute."""

from __future__ import annotations

import bpy
import numpy as np
from strata.addon.scene.nodes.arithmetic import MATH, VECTOR_MATH, VECTOR_MATH_VALUES
from strata.addon.scene.nodes.colours import BLEND


def float_image(name: str, size: int, seed: int) -> bpy.types.Image:
    """Square, of random numbers from 0 to 1 that nothing rounds; alpha is one of them."""
    image = bpy.data.images.new(name, size, size, alpha=True, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.random.default_rng(seed).random(size * size * 4, np.float32))
    return image


class RandomNodes:
    """Adds nodes to a tree, whose inputs are linked to other such nodes."""

    def __init__(self, tree: bpy.types.NodeTree, images: list[bpy.types.Image], seed: int):
        self.tree, self.images = tree, images
        self.random = np.random.default_rng(seed)
        self.used: list[str] = []

    def number(self, depth: int) -> bpy.types.NodeSocket:
        makers = [self._math] * 4 + [
            self._map_range, self._clamp, self._ramp, self._float_curve, self._separate, self._to_bw,
            self._mix, self._vector_value,
        ]  # fmt: skip
        return self._made(depth, makers, "VALUE")

    def colour(self, depth: int) -> bpy.types.NodeSocket:
        makers = [self._mix_colour] * 3 + [
            self._mix_rgb, self._invert, self._gamma, self._bright, self._hue, self._curves, self._ramp,
            self._combine, self._vector,
        ]  # fmt: skip
        return self._made(depth, makers, "RGBA")

    def _made(self, depth, makers, kind):
        return self._leaf(kind) if depth <= 0 else makers[self.random.integers(len(makers))](depth - 1)

    def _leaf(self, kind: str):
        choice = self.random.random()
        if choice < 0.6:
            node = self._node("TexImage")
            node.image = self.images[self.random.integers(len(self.images))]
            return node.outputs["Color" if kind == "RGBA" else "Alpha"]
        if choice < 0.75:
            uv = self._node("UVMap" if choice < 0.7 else "TexCoord")
            return uv.outputs["UV"]
        node = self._node("RGB" if kind == "RGBA" else "Value")
        node.outputs[0].default_value = (*self.random.random(3), 1.0) if kind == "RGBA" else self._constant()
        return node.outputs[0]

    def _constant(self) -> float:
        return float(self.random.uniform(-0.5, 1.5))

    def _node(self, kind: str):
        self.used.append(kind)
        return self.tree.nodes.new(f"ShaderNode{kind}")

    def _feed(self, node, depth: int, *identifiers: str):
        """Links some of the inputs, sets the others."""
        for socket in node.inputs:
            if socket.identifier not in identifiers:
                continue
            if self.random.random() < 0.7:
                made = self.number(depth) if socket.type == "VALUE" else self.colour(depth)
                self.tree.links.new(made, socket)
            elif socket.type == "VALUE":
                socket.default_value = self._constant()
            else:
                count = len(socket.default_value)
                socket.default_value = [self._constant() for _ in range(3)] + [1.0] * (count - 3)

    def _choose(self, options):
        return list(options)[self.random.integers(len(options))]

    def _math(self, depth):
        node = self._node("Math")
        node.operation = self._choose(MATH)
        node.use_clamp = self.random.random() < 0.3
        self.used.append(node.operation)
        self._feed(node, depth, "Value", "Value_001", "Value_002")
        return node.outputs[0]

    def _vector(self, depth):
        node = self._node("VectorMath")
        node.operation = self._choose(VECTOR_MATH)
        self._feed(node, depth, "Vector", "Vector_001", "Vector_002", "Scale")
        return node.outputs["Vector"]

    def _vector_value(self, depth):
        node = self._node("VectorMath")
        node.operation = self._choose(VECTOR_MATH_VALUES)
        self._feed(node, depth, "Vector", "Vector_001")
        return node.outputs["Value"]

    def _map_range(self, depth):
        node = self._node("MapRange")
        node.interpolation_type = self._choose(["LINEAR", "STEPPED", "SMOOTHSTEP", "SMOOTHERSTEP"])
        node.clamp = self.random.random() < 0.5
        self._feed(node, depth, "Value", "From Min", "From Max", "To Min", "To Max", "Steps")
        return node.outputs[0]

    def _clamp(self, depth):
        node = self._node("Clamp")
        node.clamp_type = self._choose(["MINMAX", "RANGE"])
        self._feed(node, depth, "Value", "Min", "Max")
        return node.outputs[0]

    def _ramp(self, depth):
        node = self._node("ValToRGB")
        node.color_ramp.interpolation = self._choose(["LINEAR", "EASE", "CONSTANT", "B_SPLINE"])
        for element in node.color_ramp.elements:
            element.color = self.random.random(4)
        node.color_ramp.elements[0].position = 0.1 + 0.3 * self.random.random()
        self._feed(node, depth, "Fac")
        return node.outputs[0 if self.random.random() < 0.8 else 1]

    def _curve_points(self, mapping):
        for curve in mapping.curves:
            curve.points.new(0.5, float(self.random.random()))
        mapping.extend = self._choose(["HORIZONTAL", "EXTRAPOLATED"])
        mapping.update()

    def _float_curve(self, depth):
        node = self._node("FloatCurve")
        self._curve_points(node.mapping)
        node.mapping.extend = "HORIZONTAL"  # where it is constant, Cycles forgets to go on
        self._feed(node, depth, "Factor", "Value")
        return node.outputs[0]

    def _curves(self, depth):
        node = self._node("RGBCurve")
        self._curve_points(node.mapping)
        self._feed(node, depth, "Fac", "Color")
        return node.outputs[0]

    def _separate(self, depth):
        if self.random.random() < 0.5:
            node = self._node("SeparateXYZ")
            self._feed(node, depth, "Vector")
        else:
            node = self._node("SeparateColor")
            node.mode = self._choose(["RGB", "HSV", "HSL"])
            self._feed(node, depth, "Color")
        return node.outputs[self.random.integers(3)]

    def _combine(self, depth):
        if self.random.random() < 0.5:
            node = self._node("CombineXYZ")
            self._feed(node, depth, "X", "Y", "Z")
        else:
            node = self._node("CombineColor")
            node.mode = self._choose(["RGB", "HSV", "HSL"])
            self._feed(node, depth, "Red", "Green", "Blue")
        return node.outputs[0]

    def _to_bw(self, depth):
        node = self._node("RGBToBW")
        self._feed(node, depth, "Color")
        return node.outputs[0]

    def _mix(self, depth):
        node = self._node("Mix")
        node.data_type, node.clamp_factor = "FLOAT", self.random.random() < 0.5
        self._feed(node, depth, "Factor_Float", "A_Float", "B_Float")
        return self._output(node, "Result_Float")

    def _mix_colour(self, depth):
        node = self._node("Mix")
        node.data_type, node.blend_type = "RGBA", self._choose(BLEND)
        self.used.append(node.blend_type)
        node.clamp_factor, node.clamp_result = self.random.random() < 0.5, self.random.random() < 0.5
        self._feed(node, depth, "Factor_Float", "A_Color", "B_Color")
        return self._output(node, "Result_Color")

    @staticmethod
    def _output(node, identifier):
        return next(socket for socket in node.outputs if socket.identifier == identifier)

    def _mix_rgb(self, depth):
        node = self._node("MixRGB")
        node.blend_type, node.use_clamp = self._choose(BLEND), self.random.random() < 0.5
        self._feed(node, depth, "Fac", "Color1", "Color2")
        return node.outputs[0]

    def _invert(self, depth):
        node = self._node("Invert")
        self._feed(node, depth, "Fac", "Color")
        return node.outputs[0]

    def _gamma(self, depth):
        node = self._node("Gamma")
        self._feed(node, depth, "Color", "Gamma")
        return node.outputs[0]

    def _bright(self, depth):
        node = self._node("BrightContrast")
        self._feed(node, depth, "Color", "Bright", "Contrast")
        return node.outputs[0]

    def _hue(self, depth):
        node = self._node("HueSaturation")
        self._feed(node, depth, "Hue", "Saturation", "Value", "Fac", "Color")
        return node.outputs[0]
