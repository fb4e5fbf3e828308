"""What an error means to an eye, in words; the same in the viewport, the panel, the table and the sheet.

One rule for all: root mean square differences, as shares of the brightness there. A picture of 8 bits rounds
its middle grey by up to half a step of 1.9%: 0.55% root mean square. What is less than that is lost in the
file that anybody looks at. An eye tells two patches from each other that differ by one or two percent
(Weber's law), which is that one step: up to there an error shows only side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

from ..core.params import Params, ParamSpec, in_words

INVISIBLE_UP_TO = 0.005
FINE_UP_TO = 0.02
LEAST_SHOWN = 0.001
MOST_SETTINGS = 3  # named in one piece of advice


class Verdict(Enum):
    """How much of an error is to be seen."""

    INVISIBLE = "invisible"
    FINE = "fine"
    VISIBLE = "visible"


def verdict(rms: float) -> Verdict:
    """Of a root mean square difference, as a share of the brightness."""
    if rms <= INVISIBLE_UP_TO:
        return Verdict.INVISIBLE
    return Verdict.FINE if rms <= FINE_UP_TO else Verdict.VISIBLE


def worded(rms: float, high: float) -> str:
    """`fine`; `fine, perhaps visible` where the interval reaches up to `high`."""
    found, worst = verdict(rms), verdict(high)
    return found.value if worst == found else f"{found.value}, perhaps {worst.value}"


def advice(settings: Sequence[str], params: type[Params] | None = None) -> str:
    """`lower it with Method Hybrid, Map Size`, as panels call the settings of an effect; empty where nothing
    does."""
    if not settings:
        return ""
    specs = {spec.name: spec for spec in params.specs()} if params else {}
    return f"lower it with {', '.join(_called(name, specs) for name in settings[:MOST_SETTINGS])}"


def _called(setting: str, specs: dict[str, ParamSpec]) -> str:
    name, _, value = setting.partition("=")
    if name not in specs:
        return in_words(name)
    spec = specs[name]
    return f"{spec.label} {spec.words.get(value, in_words(value))}".strip()


def percent(share: float) -> str:
    """For a person: `12%`, `1.2%`, `below 0.1%`. Never nothing, since no more than that is known."""
    if share < LEAST_SHOWN:
        return f"below {100.0 * LEAST_SHOWN:g}%"
    return f"{100.0 * share:.1f}%" if share < 0.0995 else f"{100.0 * share:.0f}%"


def interval_words(low: float, high: float) -> str:
    """`1.1% to 1.3%`, for a person."""
    if high < LEAST_SHOWN:
        return percent(high)
    return f"{percent(low) if low >= LEAST_SHOWN else '0%'} to {percent(high)}"
