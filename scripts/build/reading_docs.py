"""docs/reading.md, from the code that reads nodes: run as a module, this writes it."""

from __future__ import annotations

from pathlib import Path

import bpy
from strata.addon.scene.nodes import readers  # noqa: F401 (what enters the registry)
from strata.addon.scene.nodes.closures import OTHER_BSDF
from strata.addon.scene.nodes.registry import SHADERS, VALUES, Reading
from strata.addon.scene.volumes import VOLUMES

FILE = Path(__file__).resolve().parents[2] / "docs" / "reading.md"

_INTRO = """# What is read of materials

<!-- Written by `python -m strata.scripts.build.reading_docs` from the code: change that. -->

Strata reads a material from its output node for Cycles, through links, reroutes, muted nodes and node groups
as Cycles does. What comes out is how much the surface stops, its base colour, metallic, emission, and whether
it is a holdout. Roughness is not read: no effect asks for it.

- **Opacity** is 1 less the luminance of what Transparent BSDFs let through. It is read four times: for
  cameras and for shadow rays, of the front and of the back. Cycles does not heed a material's Backface
  Culling, and neither does Strata.
- **Base colour** is the share of diffuse light that comes back, of the front as a camera sees it. Of a metal
  nothing does, in the weights of layers: where Metallic hangs on a texture, the product is a picture of its
  own.
- **Emission** shines towards the camera, and lights nothing. Toon and the composite show it.
- Pictures are made of what an effect asks for, and only then.
- **Constants** are folded in float64.
- **What hangs on textures** is evaluated at texels, as many as the finest image has, and kept once however
  many materials use it. One Mapping of all of a material's textures moves the mesh's coordinates and costs
  nothing; where they differ, pictures are evaluated over the unit square, and a mesh whose UVs leave it is
  told of. A texture that is compared with a number stays a texture and a threshold, so that its edges are
  where Cycles has them.
- **What hangs on attributes** is evaluated at the corners of faces. A product with what hangs on textures is
  kept as two factors; any other function of both is not read. Of colours a corner carries one: where base
  colour, metallic and emission hang on different attributes, the first of them is read.
- **Displacement**, but for bumps, moves the vertices that a mesh has along their normals: by a Displacement
  node in object space, whose height, midlevel and scale may hang on all of this. Adaptive subdivision is not
  read, nor are Vector Displacement and a node's own Normal.
- **What is not read** is told of, with the node's name and what is assumed: it counts as opaque, and the
  viewport colour stands for the base colour. Only what the answer hangs on counts: a factor that mixes two
  opaque shaders leaves the opacity known.

## What Blender bakes

With `--read exact` (*Materials: Exact* in the panel) an output of a node that is not read is baked by Cycles,
over each mesh that shows it, and the rest of the material is read as ever. So opacity, base colour and
emission are read of all nodes, but for these, which stay as they are without it:

- what hangs on who looks from where (Fresnel, Layer Weight, Camera Data, Light Path, Incoming, Window and
  Camera coordinates), on other objects (Ambient Occlusion but for Only Local), or on what is no mesh;
- what tells the instances of one instancer apart (Object Info, the world's place), and attributes of objects,
  instancers and view layers;
- hair and points; base colour, metallic and emission of a material whose opacity is read without baking and
  has a picture of its own, or metallic where the base colour has: that would get coarser;
- displacement.

How that is done:

- Each face of a mesh gets a square of texels of its own, the larger the larger it is, so that nothing
  overlaps whatever UV maps there are. A mesh has 128 to 1024 texels a side (*Texels*, `--read-texels`), by
  how large the camera sees it, or more where its faces need it.
- Blender bakes in a scene of its own, with copies of what it needs. Nothing of that stays in the file.
- Objects that share a mesh share what is baked, unless nodes tell them apart.
- What is baked is kept, by all that it hangs on: nodes and what they read, the mesh, object and material
  where nodes ask for them, Blender's version. So a second bake, or another frame in which all that is the
  same, takes nothing. It is kept in the user's folder for caches (at most 4 GB, what was used last; another
  folder by the environment variable `STRATA_CACHE`, none where that is empty), and in memory where that
  cannot be written.
- `strata plan` and the report have a line for each such material. What a texel blurs, an audit shows.
- The render engine (F12) and previews take what is kept, and say what is not baked yet: Blender cannot bake
  while it renders. Bake once before. That does not help a preview of a mesh that is another one in renders
  (a Subdivision modifier with other levels there): what is baked is for the mesh of renders alone, and the
  preview's warning stays. With equal levels it goes.
- Where a scene is another one each time it is read (by a driver's random number, say), three rounds are
  baked, and what is not baked then is told of.
"""


def page() -> str:
    """Markdown."""
    return "\n".join(
        [
            _INTRO,
            "## Shaders of surfaces",
            "",
            *_table(SHADERS),
            "",
            "All others are not read.",
            "",
            "## Volumes, where they are the same everywhere",
            "",
            "| Node | What is read |",
            "|---|---|",
            *(f"| {_title(kind)} | {how} |" for kind, how in VOLUMES.items()),
            "",
            "A volume with any other node, or with an input that varies, is not read.",
            "",
            "## Lamps",
            "",
            "What its shaders emit, where that is constant, times its own colour and power. A lamp with",
            "anything else shines evenly, by its own colour and power.",
            "",
            "## Nodes that give numbers and colours",
            "",
            *_table(VALUES),
            "",
            "All others (Noise, Fresnel, Layer Weight, Object Info, ...) are not read, unless",
            "[Blender bakes them](#what-blender-bakes).",
            "",
        ]
    )


def _table(readings: dict[str, Reading]) -> list[str]:
    rows = ["| Node | What is read | What is not, or is assumed instead |", "|---|---|---|"]
    titled = sorted(((_title(kind), reading) for kind, reading in readings.items()), key=lambda row: row[0])
    return rows + [f"| {title} | {reading.how} | {reading.instead} |" for title, reading in titled]


def _title(kind: str) -> str:
    return "Any other BSDF with a colour" if kind == OTHER_BSDF else getattr(bpy.types, kind).bl_rna.name


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
