"""An expression as a product: of a constant, of a picture, and of what corners of faces carry."""

from __future__ import annotations

from dataclasses import dataclass

from .values import FLOAT, Attribute, Uv, Value, number, product


@dataclass(frozen=True, eq=False)
class Product:
    """Of floats, or of floats and colours; each is the float 1 where there is nothing of it."""

    uniform: Value = number(1.0)
    picture: Value = number(1.0)
    corners: Value = number(1.0)

    @property
    def value(self) -> Value:
        return product(product(self.picture, self.uniform), self.corners)


def product_of(value: Value) -> Product | None:
    """Of a float or a colour of which nothing is unread; None where a factor of it hangs on texture
    coordinates and on attributes."""
    uniform, picture, corners = number(1.0), number(1.0), number(1.0)
    for factor in _factors(value):
        if factor.is_constant:
            uniform = product(uniform, factor)
        elif factor.hangs_on(Uv) and factor.hangs_on(Attribute):
            return None
        elif factor.hangs_on(Uv):
            picture = product(picture, factor)
        else:
            corners = product(corners, factor)
    return Product(uniform, picture, corners)


def _factors(value: Value) -> list[Value]:
    if value.name == "product":
        return [factor for each in value.inputs for factor in _factors(each)]
    if value.name == "spread" and value.inputs[0].kind == FLOAT:
        return _factors(value.inputs[0])
    return [value]
