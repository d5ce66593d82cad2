"""The measured quality of a run as a short table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from imitor.cli.tables import plural, table

_UNITS: Final = {
    "_rad_s3": "rad/s³",
    "_rad_s2": "rad/s²",
    "_rad_s": "rad/s",
    "_m_s2": "m/s²",
    "_m_s": "m/s",
    "_percent": "%",
    "_frames": "frames",
    "_phases": "phases",
    "_rad": "rad",
    "_deg": "°",
    "_mm": "mm",
    "_ms": "ms",
    "_us": "µs",
    "_hz": "Hz",
    "_nm": "Nm",
    "_kg": "kg",
    "_m": "m",
    "_s": "s",
}
"""Ending of a figure's name -> unit; longer endings first."""
_SMALL: Final = {"m": ("mm", 1e3), "s": ("ms", 1e3), "rad": ("mrad", 1e3)}
"""Units in which small values read better."""
_MAIN: Final = ("value", "mean", "count")
"""Statistics that go into the first column of numbers."""
_STATISTICS: Final = frozenset({"min", "rms", "median", "std", "p1", "p5", "p95", "p99", "p99_9"})
MOST_ROWS: Final = 40
"""Of the short table."""


def quality_table(metrics: Mapping[str, Any], *, short: bool = False) -> str:
    """Return the figures of ``metrics.json`` as a table: figure, value, maximum, unit, the rest.

    A figure is a number, or a mapping of statistics with ``frames``; any other mapping is a group of figures.
    What could not be measured is left out.

    Args:
        metrics: Content of ``metrics.json``: the figures, or ``figures`` among facts about the run.
        short: Leave out the parts of which there is a whole (of ``error_m``: ``error_left_hand_m``).
    """
    figures = metrics.get("figures", metrics)
    rows = list(_rows(figures if isinstance(figures, Mapping) else {}, ""))
    if not rows:
        return "nothing was measured"
    most = len(rows)
    if short:
        wholes = [row for row in rows if not _is_part(row[0], rows)]
        most = min(len(wholes), MOST_ROWS)
        rows = [*wholes, *(row for row in rows if row not in wholes)]
    shown = [["figure", "value", "max", "unit", ""], *rows[:most]]
    text = table(shown, right=(1, 2))
    if len(rows) > most:
        text += f"\n  and {plural(len(rows) - most, 'more figure')} in metrics.json"
    return text


def simulation_text(verdict: Mapping[str, Any]) -> str:
    """Return what a physics simulation found, ``simulation`` of ``metrics.json``, as two lines."""
    if verdict["fell"]:
        text = f"simulation: it fell at {verdict['fall_time_s']:.2f} s: {verdict['fall_reason']}"
    else:
        text = f"simulation: it did not fall in {verdict['survived_s']:.2f} s"
    error, torque, inside = (
        verdict["joint_error_rad"],
        verdict["torque_to_limit"],
        verdict["zmp_inside_share"],
    )
    facts = [
        f"joint error at most {number_text(error['max'])} rad ({error['joint']})",
        f"base error at most {number_text(1e3 * verdict['base_error_m']['max'])} mm",
        f"torques at their limits {number_text(100 * torque['saturated_share'])} % of the time",
    ]
    if inside is not None:
        facts.append(f"ZMP inside {number_text(100 * inside)} %")
    for name, moved in verdict.get("objects", {}).items():
        facts.append(
            f"{name} opened {number_text(1e3 * moved['opened_m'])} mm of {number_text(1e3 * moved['asked_m'])} mm"
        )
    return f"{text}\n  {', '.join(facts)}"


def _rows(figures: Mapping[str, Any], group: str) -> Iterator[list[str]]:
    for key, figure in figures.items():
        name, unit = split_unit(str(key))
        name = f"{group} {name}".strip()
        if not isinstance(figure, Mapping):
            if isinstance(figure, int | float) and not isinstance(figure, bool):
                yield _row(name, unit, {"value": figure})
        elif "frames" in figure or "value" in figure:
            if any(statistic in figure for statistic in (*_MAIN, "max")):
                yield _row(name, unit, figure)
        else:
            yield from _rows(figure, f"{group} {words(str(key))}".strip())


def _is_part(name: str, rows: list[list[str]]) -> bool:
    return any(name.startswith(f"{row[0]} ") for row in rows)


def _row(name: str, unit: str, figure: Mapping[str, Any]) -> list[str]:
    main = next((s for s in _MAIN if s in figure), None)
    value, largest = figure.get(main or ""), figure.get("max")
    unit, factor = scale(unit, value, largest)
    rest = []
    for statistic, other in figure.items():
        if statistic in (main, "max", "frames"):
            continue
        if statistic.endswith("share"):
            rest.append(
                f"{words(statistic.removesuffix('share')).strip()} {number_text(other, 100.0)} %".strip()
            )
        elif isinstance(other, str):
            rest.append(f"{words(statistic)} {other}")
        else:  # the figure's unit holds for its statistics, not for counts beside them
            rest.append(
                f"{words(statistic)} {number_text(other, factor if statistic in _STATISTICS else 1.0)}"
            )
    if isinstance(figure.get("frames"), int):
        rest.append(f"over {figure['frames']} frames")
    return [name, number_text(value, factor), number_text(largest, factor), unit, ", ".join(rest)]


def words(key: str) -> str:
    """Return a key as words."""
    return key.replace("_", " ")


def split_unit(key: str) -> tuple[str, str]:
    """Return the words of a figure's name and its unit: ``com_error_m`` -> ``com error``, ``m``."""
    for ending, unit in _UNITS.items():
        if key.endswith(ending) and len(key) > len(ending):
            return words(key.removesuffix(ending)), unit
    return words(key), ""


def scale(unit: str, *values: Any) -> tuple[str, float]:
    """Return the unit in which the values read best, and the factor to it."""
    sizes = [abs(v) for v in values if isinstance(v, int | float) and math.isfinite(v)]
    if unit in _SMALL and sizes and 0 < max(sizes) < 0.1:
        return _SMALL[unit]
    return unit, 1.0


def number_text(value: Any, factor: float = 1.0) -> str:
    """Return a value with three digits; empty when there is none."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int) and factor == 1.0:
        return str(value)
    if not isinstance(value, int | float):
        return value if isinstance(value, str) else ""
    if not math.isfinite(value):
        return "-"
    text = f"{value * factor:.3g}"
    return f"{value * factor:.0f}" if "e" in text and abs(value * factor) >= 1 else text
