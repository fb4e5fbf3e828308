"""`strata report` from the command line: what it leaves, what stops it, and how it goes on."""

from __future__ import annotations

import csv
import json
import re

import bpy
import pytest
from strata.addon.report import sweep
from strata.ops.cli import main
from strata.tests.support.places import SAMPLES

SCENE = SAMPLES / "stacked.blend"


def report(folder, *words, scene=SCENE) -> int:
    small = ("--size", "64x36", "--backend", "cpu", "--repeats", "1", "--samples", "1,4", "--samples-only")
    return main(["report", str(scene), "-o", str(folder), *small, *words])


def runs_of(folder) -> list[dict]:
    return [json.loads(line) for line in (folder / "runs.jsonl").read_text().splitlines()[1:]]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    assert report(folder, "--effects", "soft_shadow") == 0
    return folder


def test_errors_fall_and_figures_agree(made):
    data = json.loads((made / "report.json").read_text())
    points = {point["samples"]: point for point in data["points"]}
    assert set(points) == {1, 4}
    layers = {samples: point["layers"]["Soft Shadow Panel"] for samples, point in points.items()}
    assert layers[4]["value"] < 0.7 * layers[1]["value"]
    for each in layers.values():
        low, high = each["ci95"]
        assert low <= each["value"] <= high
        # What the bake says of itself by other rays at other pixels, and its interval, hold the same error.
        reported = each["reported"]["ci95"]
        assert reported[0] <= high
        assert low <= reported[1]
    assert all(point["cpu_s"][1] > 0.0 and point["wall_s"][1] > 0.0 for point in points.values())


def test_files(made):
    page = (made / "report.html").read_text(encoding="utf-8")
    assert "Soft Shadow Panel" in page
    assert "<svg" in page
    assert "data:image/png;base64," in page
    assert not re.search(r'(src|href)="(?!data:)', page)  # it needs nothing beside it
    with open(made / "report.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["samples"] for row in rows] == ["1", "4"]
    for name in ("plots/Soft_Shadow_Panel.png", "plots/Soft_Shadow_Panel.svg", "runs.jsonl"):
        assert (made / name).stat().st_size > 500
    image = bpy.data.images.load(str(made / "plots" / "Soft_Shadow_Panel.png"))
    assert tuple(image.size) == (900, 480)
    bpy.data.images.remove(image)


def test_it_goes_on_and_does_nothing_twice(tmp_path, monkeypatch):
    kept, own_run = [], sweep.Sweep._own_run

    def stopped(self, setting, number):
        if len(kept) == 2:
            raise KeyboardInterrupt
        kept.append((setting.key, number))
        return own_run(self, setting, number)

    monkeypatch.setattr(sweep.Sweep, "_own_run", stopped)
    assert report(tmp_path, "--effects", "soft_shadow") == 130
    assert len(runs_of(tmp_path)) == 2
    assert "Nothing has been timed yet" in (tmp_path / "report.html").read_text()
    with open(tmp_path / "runs.jsonl", "a") as file:
        file.write('{"key": "cut o')  # as a kill leaves it
    again = []

    def counted(self, setting, number):
        again.append((setting.key, number))
        return own_run(self, setting, number)

    monkeypatch.setattr(sweep.Sweep, "_own_run", counted)
    assert report(tmp_path, "--effects", "soft_shadow") == 0
    assert not set(kept) & set(again)
    assert len(kept) + len(again) == 4
    assert report(tmp_path, "--effects", "soft_shadow") == 0
    assert len(again) == 2


def test_another_report_is_not_mixed_in(made, capfd):
    assert report(made, "--effects", "soft_shadow", "--seed", "3") == 2
    assert "holds another report (seed differ)" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--rivals", "nobody"), "no rival 'nobody'; there is cycles"),
        (("--samples", "0"), "is not a whole number"),
        (("--effects", "nothing"), "no effect 'nothing'"),
        (("--frames", "1-2"), "a report is of one frame"),
    ],
)
def test_wrong_words_are_one_line(tmp_path, capfd, words, says):
    assert report(tmp_path / "folder", *words) == 2
    error = capfd.readouterr().err.strip()
    assert says in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "folder").exists()


def test_a_file_is_no_folder(tmp_path, capfd):
    (tmp_path / "file").write_text("")
    assert report(tmp_path / "file") == 2
    assert "is not a folder" in capfd.readouterr().err


def test_a_scene_without_layers(tmp_path):
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.context.scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(bpy.context.scene.camera)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "empty.blend"))
    assert report(tmp_path / "out", scene=tmp_path / "empty.blend") == 0
    assert "no layer whose error is measured" in (tmp_path / "out" / "report.html").read_text()
