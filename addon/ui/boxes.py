"""A box beside a value that need not be there: off, the value is the one that stands for none, and the row
shows a word in its place. Nothing is kept but the value."""

from __future__ import annotations

import bpy


def box_name(name: str) -> str:
    """Of the box beside the property `name`."""
    return f"{name}_is_set"


def box(name: str, off: float, first: float, label: str, description: str):
    """The bpy property of the box: `off` is what the value is without it, `first` what with it at first."""

    def is_on(group) -> bool:
        return not is_off(group, name, off)

    def switch(group, on: bool) -> None:
        setattr(group, name, first if on else off)

    return bpy.props.BoolProperty(name=label, description=description, get=is_on, set=switch, options=set())


def is_off(group, name: str, off: float) -> bool:
    """Whether a property holds what stands for none; Blender keeps it in float32."""
    return abs(getattr(group, name) - off) <= 1e-6 * abs(off)


def row(layout: bpy.types.UILayout, group, name: str, word: str) -> None:
    """The box, and its value or, without one, `word`."""
    line = layout.row(align=True, heading=group.bl_rna.properties[name].name)
    line.use_property_decorate = False
    line.prop(group, box_name(name), text="")
    value = line.row(align=True)
    if getattr(group, box_name(name)):
        value.prop(group, name, text="")
        line.prop_decorator(group, name)
    else:
        value.active = False
        value.label(text=word)
        line.label(text="", icon="BLANK1")
