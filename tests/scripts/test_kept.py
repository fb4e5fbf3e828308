"""What scripts found of many scenes is kept, and found only once."""

from __future__ import annotations

from strata.scripts.bench.kept import kept_lines


def test_a_run_that_was_stopped_goes_on(tmp_path, capsys):
    kept, asked = tmp_path / "data" / "kept.jsonl", []

    def found_of(scene):
        asked.append(scene)
        if scene == 2:
            raise ValueError("broken")
        return [{"scene": scene, "error": 1.0 / 3.0 + each} for each in range(scene)]

    first = kept_lines(range(2), kept, found_of)
    assert first == [{"scene": 1, "error": 0.33333}]
    lines = kept_lines(range(4), kept, found_of)
    assert asked == [0, 1, 2, 3]  # scene 0, of which there is nothing to say, is not asked again
    assert [line["scene"] for line in lines] == [1, 3, 3, 3]
    assert "scene 2 failed: ValueError('broken')" in capsys.readouterr().err
    kept_lines(range(4), kept, found_of)
    assert asked == [0, 1, 2, 3, 2]
    assert kept_lines([3], kept, found_of) == lines[1:]
