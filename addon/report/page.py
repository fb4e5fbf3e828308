"""One HTML page of a report that needs nothing beside it: plots, tables, pictures of differences."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

from ..measure.verdict import percent
from .judge import IMAGES
from .picture import SHOWN
from .plot import Mark, log_log
from .result import WORST, Point, Result
from .rivals.registry import RIVALS
from .setting import OURS

ACROSS = "CPU seconds, all cores, everything counted"
NEAR = 0.02
"""Of each curve the point whose error is nearest to this has its picture shown."""
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em; color: #222;
       background: #fff; }
table { border-collapse: collapse; display: block; overflow-x: auto; margin: 1em 0; }
td, th { border: 1px solid #ccc; padding: .2em .6em; text-align: left; }
td.number { text-align: right; font-variant-numeric: tabular-nums; } tr.best { background: #eef7ee; }
svg { max-width: 100%; height: auto; } figure { display: inline-block; margin: .5em 1em .5em 0; width: 19em;
  vertical-align: top; } figure img { width: 100%; image-rendering: auto; border: 1px solid #ccc; }
figcaption { font-size: .85em; }
"""


def drawing(result: Result, layer: str):
    """The plot of one layer, or of the worst."""
    best = result.front(layer)
    curves = []
    for (who, curve), points in result.curves(layer).items():
        marks = [
            Mark(
                point.cpu.median,
                error.value,
                (point.cpu.low, point.cpu.high),
                (error.low, error.high),
                point.setting.key in best,
            )
            for point, error in points
        ]
        counted = points[0][0].setting.counted
        curves.append((named(who, curve, counted), marks))
    return log_log(layer, ACROSS, "error in use" if _is_in_use(result, layer) else "error", curves)


def named(who: str, curve: str, counted: str) -> str:
    """A curve in words."""
    swept = "" if counted == "samples" else " (its values)"
    return f"{'Strata' if who == OURS else who}: {curve}{swept}"


def page(result: Result, folder: Path) -> str:
    """`folder` has the pictures."""
    title = f"Error against time: {result.told['scene']}"
    body = [f"<h1>{html.escape(title)}</h1>", _about(result)]
    for warning in result.warnings:
        body.append(f"<p><b>{html.escape(warning)}</b></p>")
    if not result.shown:
        why = (
            "Nothing has been timed yet."
            if result.points
            else "This scene has no layer whose error is measured."
        )
        body.append(f"<p>{why}</p>")
    for layer in result.shown:
        body += [f"<h2>{html.escape(layer)}</h2>", drawing(result, layer).svg(), _orders(result, layer)]
        if layer == WORST:
            body.append("<p>Of the layers that multiply, the one that is furthest off.</p>")
            continue
        body += [_figures(result, layer), _pictures(result, layer, folder)]
    head = f'<meta charset="utf-8"><title>{html.escape(title)}</title><style>{STYLE}</style>'
    return f"<!DOCTYPE html>\n<html><head>{head}</head><body>\n" + "\n".join(body) + "\n</body></html>\n"


def _about(result: Result) -> str:
    told = result.told
    words = [f"frame {told['frame']}", f"view layer {told['view_layer']}", f"seed {told['seed']}"]
    if told["size"]:
        words.append("{}x{}".format(*told["size"]))
    there = {point.setting.who for point in result.points}
    machine = "; ".join(f"{key} {value}" for key, value in result.environment.items())
    return (
        f"<p>{html.escape(', '.join(words))}. {html.escape(machine)}.</p>"
        "<p>The error is that of each layer used as it is meant to be, a share of the brightness, "
        "root mean square over the pixels. What layers should be is found once by rays through every "
        "pixel's footprint, and is the same for all; bars are 95% intervals. Times are of whole runs "
        "that measure nothing: reading the scene, maps, trees, samples; the median of the repeats, "
        "bars from the least to the most. Filled: none is both cheaper and nearer (Pareto's front).</p>"
        + "".join(
            f"<p>{html.escape(f'{rival.title}: {rival.told}')}</p>" for rival in RIVALS if rival.id in there
        )
    )


def _is_in_use(result: Result, layer: str) -> bool:
    return any("value" in point.layers.get(layer, {}) for point in result.points) or layer == WORST


def _orders(result: Result, layer: str) -> str:
    rows = []
    for (who, curve), order in result.orders(layer).items():
        points = result.curves(layer)[who, curve]
        counted = points[0][0].setting.counted
        if order is None:
            continue
        half = "" if order.power_95 is None else f" ± {order.power_95:.2f}"
        floor = percent(order.floor) if order.floor > 0.0 else "none seen"
        rows.append([named(who, curve, ""), counted, f"{order.power:.2f}{half}", floor])
    if not rows:
        return ""
    text = "<p>How errors fall: error² = (a · N<sup>&minus;p</sup>)² + floor², fitted.</p>"
    return text + _table(["curve", "N", "p", "floor"], rows)


def _figures(result: Result, layer: str) -> str:
    best, rows, classes = result.front(layer), [], []
    for points in result.curves(layer).values():
        for point, error in points:
            found = point.layers[layer]
            reported = found.get("reported", {})
            parts = [percent(reported[name]) if name in reported else "" for name in ("method", "sampling")]
            itself = ""
            if "value" in reported:
                low, high = reported["ci95"]
                upper = "?" if high is None else percent(high)
                itself = f"{percent(reported['value'])} ({percent(low)} to {upper})"
            setting = point.setting
            rows.append(
                [
                    named(setting.who, setting.curve, ""),
                    f"{setting.counted} {setting.step:g}",
                    f"{percent(error.value)} ({percent(error.low)} to {percent(error.high)})",
                    itself,
                    *parts,
                    f"{point.cpu.median:.3g} ({point.cpu.low:.3g} to {point.cpu.high:.3g})",
                    f"{point.wall.median:.3g}",
                    "" if point.memory_mb is None else f"{point.memory_mb:.0f}",
                ]
            )
            classes.append("best" if setting.key in best else "")
    header = ["curve", "", "error", "as the bake says", "method", "sampling", "CPU s", "s", "MiB"]
    return _table(header, rows, classes)


def _pictures(result: Result, layer: str, folder: Path) -> str:
    figures = []
    for (who, curve), points in result.curves(layer).items():
        pictured = [(point, error) for point, error in points if "image" in point.layers[layer]]
        if not pictured:
            continue
        point, error = min(pictured, key=lambda each: abs(each[1].value - NEAR))
        path = folder / IMAGES / point.layers[layer]["image"]
        try:
            data = base64.b64encode(path.read_bytes()).decode()
        except OSError:
            continue
        words = f"{named(who, curve, 'samples')}, {_step(point)}: {percent(error.value)}"
        figures.append(
            f'<figure><img src="data:image/png;base64,{data}" alt=""><figcaption>{html.escape(words)}'
            "</figcaption></figure>"
        )
    if not figures:
        return ""
    text = (
        f"<p>Where it is off, of each curve the point nearest to {percent(NEAR)}: red too bright, blue too "
        f"dark, full colour at {percent(SHOWN)} of the brightness. The rays' noise is in it.</p>"
    )
    return text + "".join(figures)


def _step(point: Point) -> str:
    return f"{point.setting.step:g} {point.setting.counted}"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], classes: Sequence[str] = ()) -> str:
    lines = ["<tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in header) + "</tr>"]
    for number, row in enumerate(rows):
        kind = f' class="{classes[number]}"' if classes and classes[number] else ""
        cells = (
            f"<td{' class=number' if cell[:1].isdigit() else ''}>{html.escape(cell)}</td>" for cell in row
        )
        lines.append(f"<tr{kind}>" + "".join(cells) + "</tr>")
    return "<table>" + "\n".join(lines) + "</table>"
