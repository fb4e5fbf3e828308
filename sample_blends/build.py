"""Makes the sample scenes: `python sample_blends/build.py [name ...]` (all of them without a name).

Needs only the bpy module. Everything is made from code and seeded, so building twice gives the same scenes.
"""

import argparse

import _comic
import _courtyard
import _kit as kit
import _mist
import _scenes

bench_scene = _scenes.bench_scene

SCENES = {
    "courtyard": _courtyard.courtyard,
    "dandelion": _scenes.dandelion,
    "stacked": _scenes.stacked,
    "plain": _scenes.plain,
    "animated": _scenes.animated,
    "mist": _mist.mist,
    "comic": _comic.comic,
}


def build(names, only_opening=False):
    """Build and save the named scenes and print what each evaluates to. `only_opening`: what they open with
    is written into the files there are, whose layers keep their bits; building anew may round otherwise."""
    print(f"{'scene':<12}{'triangles':>11}{'meshes':>9}{'bytes':>10}  digest")
    for name in names:
        if only_opening:
            kit.bpy.ops.wm.open_mainfile(filepath=str(kit.FOLDER / f"{name}.blend"))
        else:
            SCENES[name]()
        kit.opens_with(toon=name == "comic")
        size = kit.save(kit.FOLDER / f"{name}.blend")
        found = kit.statistics()
        print(
            f"{name:<12}{found['triangles']:>11,}{found['drawn']:>9,}{size:>10,}  {found['digest']}",
            flush=True,
        )


def main():
    """Read the names from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help=f"from {', '.join(SCENES)}; all without one")
    parser.add_argument("--opening", action="store_true", help="only what the files that are there open with")
    arguments = parser.parse_args()
    names = arguments.names
    if unknown := [name for name in names if name not in SCENES]:
        parser.error(f"no such scene: {', '.join(unknown)}")
    build(names or SCENES, arguments.opening)


if __name__ == "__main__":
    main()
