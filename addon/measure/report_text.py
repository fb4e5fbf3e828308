"""What a bake reports, as text for a person in a terminal."""

from __future__ import annotations

from itertools import compress

from .report import LayerError, LayerReport, NotMeasured, Report
from .table import columns, heading, wrapped
from .verdict import interval_words, percent

STEPS_SHOWN = 10
USUAL_METRIC = "in use"


def format_table(report: Report) -> str:
    """The report for a person, at most 110 columns wide."""
    width, height = report.size
    lines = [
        heading(f"{report.scene}, frame {report.frame}, {width} x {height}"),
        *wrapped(f"{report.backend} ({report.backend_reason})", "backend  "),
        f"time     {_seconds(report.seconds)} in all"
        + (f", of which {_seconds(report.compile_seconds)} compiling" if report.compile_seconds else "")
        + (f"; peak memory {report.peak_mb} MB" if report.peak_mb else ""),
        *([report.memory.sentence.replace("memory: ", "memory   ")] if report.memory else []),
        "",
        *columns(*_layer_rows(report)),
        *[line for layer in report.layers for line in _notes(layer)],
        "",
        *columns(["step", "for", "device", "seconds"], _step_rows(report)),
    ]
    if report.left_out:
        lines += ["", "left out"]
        lines += [line for what, why in report.left_out for line in wrapped(why, f"  {what}: ")]
    if report.baked:
        lines += ["", "materials"]
        lines += [line for told in report.baked for line in wrapped(told, "  ")]
    if report.warnings:
        lines += ["", "warnings"]
        lines += [line for warning in report.warnings for line in wrapped(warning, "  ")]
    return "\n".join(lines)


def _seconds(value: float) -> str:
    return f"{value:.2f} s"


def _layer_rows(report: Report) -> tuple[list[str], list[list[str]]]:
    """The titles and a row for each layer. Samples are there where layers have their own, metrics where
    one is another than that of most."""
    titles = ["layer", "samples", "s", "error", "95% interval", "to an eye", "99%", "max", "metric"]
    rows = []
    for layer in report.layers:
        row = [layer.name, str(layer.samples or ""), f"{layer.seconds:.2f}"]
        if not isinstance(layer.error, LayerError):
            row += ["neutral" if layer.neutral else "not measured", "", "", "", "", ""]
        else:
            error = layer.error
            row += [percent(error.value), interval_words(*error.ci95), layer.verdict]
            row += [percent(error.p99), percent(error.max), error.metric]
        if layer.non_finite:
            row[-1] = f"{row[-1]}; {layer.non_finite} values are not finite".lstrip("; ")
        rows.append(row)
    has_samples = any(layer.in_passes for layer in report.layers)
    shown = [1] * len(titles)
    shown[1], shown[-1] = has_samples, any(row[-1] not in ("", USUAL_METRIC) for row in rows)
    titles, *rows = (list(compress(row, shown)) for row in (titles, *rows))
    return titles, rows


def _notes(layer: LayerReport) -> list[str]:
    if isinstance(layer.error, NotMeasured):
        return wrapped(layer.error.why, f"  {layer.name} is not measured: ")
    told = [layer.target_words, layer.words, layer.audit.words if layer.audit else ""]
    return [line for words in filter(None, told) for line in wrapped(words, f"  {layer.name}: ")]


def _step_rows(report: Report) -> list[list[str]]:
    """The slowest steps, then all others as one."""
    steps = sorted(report.steps, key=lambda step: -step.seconds)
    shown, others = steps[:STEPS_SHOWN], steps[STEPS_SHOWN:]
    rows = [[step.name, step.instance, step.device, f"{step.seconds:.3f}"] for step in shown]
    if others:
        rows.append([f"{len(others)} others", "", "", f"{sum(step.seconds for step in others):.3f}"])
    return rows
