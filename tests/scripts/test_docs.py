"""Documents that a machine can check: effects' pages name all that they declare, links lead somewhere."""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from strata.addon.effects.registry import EFFECTS
from strata.scripts.build import reading_docs
from strata.scripts.build.docs_html import pages
from strata.scripts.build.effect_docs import FOLDER, page, steps_of
from strata.tests.support.places import ROOT

# As they are in the repository: what is made of them is not.
DOCUMENTS = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/**/*.md", "addon/**/*.md", "sample_blends/*.md", "tests/*.md")
    for path in ROOT.glob(pattern)
    if FOLDER not in path.parents
)


def links(text: str) -> list[str]:
    """Those that lead to files, without what is behind a #."""
    found = re.findall(r"\]\(([^)#\s]+)[^)]*\)", text)
    return [target for target in found if not target.startswith(("http://", "https://", "mailto:"))]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.id)
def test_effect_pages_name_every_layer_parameter_and_step(effect):
    rows = re.findall(r"^\| ([^|]+) \|", page(effect), re.MULTILINE)
    assert {f"`{thing.name}`" for thing in (*effect.params.specs(), *steps_of(effect))} < set(rows)
    assert all(any(row.startswith(kind.title) for row in rows) for kind in effect.layers)
    for target in links(page(effect)):
        assert (FOLDER / target).resolve().exists(), target


def test_the_page_of_an_effect_says_which_layers_nobody_measures():
    effect, *_ = EFFECTS
    kind = replace(effect.layers[0], score=None)
    assert "| not measured |" in page(replace(effect, layers=(kind,)))


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_somewhere(document):
    path = ROOT / document
    for target in links(path.read_text(encoding="utf-8")):
        assert (path.parent / target).exists(), f"{document}: {target}"


def test_files_that_are_named_anywhere_are_there():
    """In documents and in comments."""
    listing = ["git", "ls-files", "*.md", "*.py", "*.rs", "*.glsl", "*.toml", "Makefile", ".ci/run"]
    files = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True).stdout.split()
    for file in files:  # none in a source archive
        path = ROOT / file
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        for named in re.findall(
            r"(?<![\w/])(?:tests|scripts|addon|ops|docs|kernels)/[\w/]+\.(?:py|rs|md|glsl)\b", text
        ):
            made = named.startswith("docs/effects/") or "/distance_fade/" in named  # the guide's own effect
            assert made or (ROOT / named).exists(), f"{file}: {named}"


@pytest.mark.parametrize("document", DOCUMENTS)
def test_files_that_a_document_calls_by_their_last_name_are_there(document):
    listing = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True).stdout.split()
    there = {Path(file).name for file in listing}
    for named in re.findall(r"`([\w/]+\.(?:py|rs|glsl))`", (ROOT / document).read_text(encoding="utf-8")):
        of_guide = "distance_fade" in named
        assert of_guide or not there or Path(named).name in there, (
            f"{document}: {named}"
        )  # none in an archive


def test_pages_for_a_browser_link_to_each_other():
    """What the extension carries needs no network and no repository."""
    made = pages()
    assert len(made) > 10
    for name, text in made.items():
        assert text.startswith("<!DOCTYPE html>")
        targets = re.findall(r'href="([^"]+)"', text)
        assert targets, name
        for target in targets:
            page, _, anchor = target.partition("#")
            assert page in made, f"{name}: {target}"
            assert not anchor or f'id="{anchor}"' in made[page], f"{name}: {target}"
        words = re.sub(r"<code>.*?</code>|<pre>.*?</pre>|<style>.*?</style>", "", text, flags=re.DOTALL)
        assert not re.search(r"\*\*|\]\(|^#|\|--|`", words, re.MULTILINE), f"Markdown is left over in {name}"


def test_every_dependency_is_accounted_for():
    text = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8").lower()
    pins = re.findall(r"^([\w.-]+)", (ROOT / "requirements.in").read_text(), re.MULTILINE)
    crates = (ROOT / "kernels" / "Cargo.toml").read_text().split("[dependencies]")[1].split("[")[0]
    for name in [*pins, *re.findall(r"^(\w+) =", crates, re.MULTILINE)]:
        assert name.lower() in text, name


def test_readme_tells_the_make_targets_that_exist():
    makefile = (ROOT / "Makefile").read_text()
    told = set(re.findall(r"`?make (\w+)", (ROOT / "README.md").read_text()))
    for target in told:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    dry = subprocess.run(["make", "--dry-run", "lint"], cwd=ROOT, capture_output=True, text=True)
    assert dry.returncode == 0, dry.stderr


def test_the_page_on_reading_is_what_the_code_says():
    assert reading_docs.FILE.read_text(encoding="utf-8") == reading_docs.page(), "run reading_docs"
