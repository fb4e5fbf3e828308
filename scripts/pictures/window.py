"""Makes the documents' pictures of a Blender window from the photographs that `make test-interface` takes:
after it, `python -m strata.scripts.pictures.window`."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
PHOTOGRAPHS = ROOT / "out" / "interface"
PICTURES = {
    "panel": "opengl/5 baked",
    "tutorial_sidebar": "opengl story/1 sidebar",
    "tutorial_baked": "opengl story/2 baked",
    "tutorial_preview": "opengl story/3 preview",
    "tutorial_engine": "opengl story/4 engine",
    "tutorial_compositor": "opengl story/5 compositor",
    "tutorial_imported": "opengl imported/6 imported",
}
"""Photographs by the names of the pictures."""

WIDTH = 1000  # pixels; the window's are 1400
COLOURS = 200  # of a palette: a fifth of the bytes


def main() -> None:
    """Writes docs/images/*.png."""
    for name, photograph in PICTURES.items():
        with Image.open(PHOTOGRAPHS / f"{photograph}.png") as image:
            height = round(image.height * WIDTH / image.width)
            small = image.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
        path = ROOT / "docs" / "images" / f"{name}.png"
        small.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
        print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
