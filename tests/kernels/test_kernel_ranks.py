"""No module of the kernels uses one that uses it, no effect uses another, and only effects know effects."""

from __future__ import annotations

import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter

import pytest
from strata.tests.support.places import ROOT

SOURCES = ROOT / "kernels" / "src"
EFFECTS = sorted(
    path.name for path in (SOURCES / "effects").iterdir() if path.is_dir() and path.name != "shared"
)
COMMENT = re.compile(r"//.*")
INLINE_MODULE = re.compile(r"\bmod (\w+) \{")
NAMED = re.compile(r"(?<![\w:])((?:\w+::)+(?:\w+|\{[^;{}]*(?:\{[^;{}]*\}[^;{}]*)*\}|\*))")


def modules() -> dict[str, str]:
    """Source by module: "" is lib.rs, "raster::tile" raster/tile.rs."""
    found = {}
    for path in sorted(SOURCES.rglob("*.rs")):
        parts = path.relative_to(SOURCES).with_suffix("").parts
        name = "::".join(parts[:-1] if parts[-1] in ("mod", "lib") else parts)
        found[name] = COMMENT.sub("", path.read_text(encoding="utf-8"))
    return found


def expanded(path: str) -> Iterator[str]:
    """`a::{b, c::d}` is a::b and a::c::d."""
    before, brace, rest = path.partition("{")
    if not brace:
        yield path
        return
    depth, part = 0, ""
    for letter in rest[: rest.rindex("}")] + ",":
        if letter == "," and depth == 0:
            yield from expanded(before + part.strip())
            part = ""
            continue
        depth += (letter == "{") - (letter == "}")
        part += letter


def by_inline_module(source: str) -> Iterator[tuple[int, str]]:
    """The parts of a file, and how many inline modules each is in."""
    inside = INLINE_MODULE.search(source)
    if not inside:
        yield 0, source
        return
    depth, end = 1, inside.end()
    while depth:
        depth += {"{": 1, "}": -1}.get(source[end], 0)
        end += 1
    yield 0, source[: inside.start()]
    yield from ((level + 1, part) for level, part in by_inline_module(source[inside.end() : end - 1]))
    yield from by_inline_module(source[end:])


def uses(module: str, source: str, known: set[str]) -> set[str]:
    """The modules that a module names, by `crate`, `super`, `self` or its own children."""
    found = set()
    for level, part in by_inline_module(source):
        here = module.split("::") if module else []
        for path in (path for named in NAMED.findall(part) for path in expanded(named)):
            parts = path.split("::")
            if parts[0] == "crate":
                whole = parts[1:]
            elif parts[0] in ("super", "self"):
                up = sum(1 for word in parts if word == "super")
                whole = (here + [""] * level)[: len(here) + level - up] + parts[max(up, 1) :]
            elif "::".join([*here, parts[0]]) in known:
                whole = here + parts
            else:
                continue
            while "::".join(whole) not in known:
                whole = whole[:-1]
            found.add("::".join(whole))
    return found - {module}


def graph(sources: dict[str, str]) -> dict[str, set[str]]:
    return {module: uses(module, source, set(sources)) for module, source in sources.items()}


def circle(sources: dict[str, str]) -> list[str]:
    """Some modules, each used by the next; empty where there are no circles."""
    try:
        TopologicalSorter(graph(sources)).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def owner(module: str) -> str | None:
    """The folder of `effects` that a module lies in."""
    parts = module.split("::")
    return parts[1] if parts[0] == "effects" and len(parts) > 1 else None


def breaches(sources: dict[str, str]) -> list[str]:
    """Modules of effects that others than the same effect use."""
    found = []
    for module, used in graph(sources).items():
        for target in used:
            is_list = module in ("", "effects")
            is_own = owner(module) == owner(target) or (owner(module) and owner(target) == "shared")
            if target.startswith("effects") and not is_list and not is_own:
                found.append(f"{module} uses {target}")
    return found


def test_no_module_uses_one_that_uses_it():
    assert circle(modules()) == []


def test_no_effect_uses_another():
    assert breaches(modules()) == []


def test_only_effects_name_effects():
    for module, source in modules().items():
        if not module.startswith("effects"):
            assert not [effect for effect in EFFECTS if effect in source], module


@pytest.mark.parametrize(
    ("sources", "is_circle"),
    [
        ({"": "mod a;", "a": "use b::C;", "a::b": "use super::D;"}, True),
        ({"": "mod a;", "a": "mod b; pub use b::C;", "a::b": "pub(super) struct C;"}, False),
        ({"": "", "a": "use crate::{b::C, d};", "b": "fn f() { g(crate::a::h()) }"}, True),
        ({"": "", "a": "use crate::b::{C, D};", "b": "mod tests { use super::*; }"}, False),
        ({"": "", "a": "mod t { use super::super::b; }", "b": "use crate::a::t;"}, True),
        ({"": "", "a": "use super::b;", "b": "use super::c;", "c": "use super::a;"}, True),
    ],
)
def test_circles_are_found(sources, is_circle):
    assert bool(circle(sources)) == is_circle


@pytest.mark.parametrize(
    "sources",
    [
        {"": "", "effects::a": "use crate::effects::b::C;", "effects::b": ""},
        {"": "", "effects::shared": "use super::a;", "effects::a": ""},
        {"": "", "rays": "use crate::effects::shared::C;", "effects::shared": ""},
    ],
)
def test_breaches_are_found(sources):
    assert len(breaches(sources)) == 1
