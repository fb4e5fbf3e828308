"""What the panel keeps and draws of bakes and plans."""

from __future__ import annotations

import numpy as np
from strata.addon.bake import read_scene
from strata.addon.measure.report import LayerError, NotMeasured
from strata.addon.planning import Options, plan_scene
from strata.addon.scene.open import choose
from strata.addon.ui import plot
from strata.addon.ui.state import STATE, Mark


def test_plot_puts_less_error_lower_and_more_time_to_the_right():
    curve = [Mark(0.1, 0.1), Mark(1.0, 0.001)]
    image = plot.draw([curve])
    assert image.shape == (plot.HEIGHT, plot.WIDTH, 4)
    is_curve = np.abs(image[:, :, :3] - plot.colour_of(0)).max(axis=2) < 0.01
    rows, columns = np.nonzero(is_curve)
    left, right = columns < plot.WIDTH // 4, columns > 3 * plot.WIDTH // 4
    assert rows[left].min() > 3 * plot.HEIGHT // 4
    assert rows[right].max() < plot.HEIGHT // 4
    assert right.sum() > 2 * left.sum(), "the last bake is the larger disk"


def test_plot_of_nothing_is_empty():
    assert np.ptp(plot.draw([])[:, :, 0]) < 0.2
    assert np.isfinite(plot.draw([[Mark(0.0, 0.1), Mark(1.0, 0.0)]])).all()


def test_history_is_kept_by_scene_and_is_bounded():
    error = LayerError("in use", 0.5, (0.4, 0.6), 0.0, 0.9, 1.0, 64, "ray traced", 0.01, 0.1)
    layers = [
        {"name": "A", "seconds": 1.0, "error": error.to_json()},
        {"name": "B", "seconds": 1.0},
        {"name": "C", "seconds": 1.0, "error": NotMeasured("no memory").to_json()},
    ]
    report = {"layers": layers}
    try:
        for _ in range(1000):
            STATE.show_report(-1, report)
        assert set(STATE.marks[-1]) == {"A"}
        assert 1 < len(STATE.marks[-1]["A"]) < 100
    finally:
        STATE.clear()


def test_plan_is_shown_beside_what_it_is_about(scene):
    chosen = choose()
    outline, graph, _, _ = read_scene(chosen.scene, chosen.view_layer, Options())
    STATE.show_plan(-1, plan_scene(outline, graph.shot, Options()))
    rows = STATE.plans[-1]
    assert {row.light for row in rows if not row.kept} >= {entry.light for entry in graph.left_out}
    assert all(row.reason for row in rows if not row.kept)
    STATE.clear()
