"""The progress of a run and the tables: pure text."""

from __future__ import annotations

import io
import math
import time
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor.cli.progress import Progress
from imitor.cli.quality_table import quality_table, split_unit
from imitor.cli.show import type_text
from imitor.cli.tables import plural, table


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Broken(io.StringIO):
    def write(self, text: str) -> int:
        raise BrokenPipeError


def test_lines_every_tenth_where_there_is_no_terminal() -> None:
    stream = io.StringIO()
    progress = Progress(stream, rate_hz=100.0)
    for i in range(1, 26):
        progress(i, 25)
    lines = stream.getvalue().splitlines()
    assert [line.split(" (")[0] for line in lines] == [
        f"frame {n} of 25" for n in (3, 5, 8, 10, 13, 15, 18, 20, 23, 25)
    ]
    assert lines[0].startswith("frame 3 of 25 (12 %)")
    assert "× real time" in lines[-1]


def test_lines_by_time_where_the_end_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    stream = io.StringIO()
    progress = Progress(stream)
    for i in range(1, 26):
        progress(i, None)
        now[0] += 1.0
    assert stream.getvalue() == "frame 11, 1.1 frames/s\nframe 21, 1.1 frames/s\n"


def test_a_bar_on_a_terminal() -> None:
    stream = Terminal()
    with Progress(stream, rate_hz=50.0) as progress:
        progress(1, 10)
        progress.say("[careful] a note")
        progress(10, 10)
    text = stream.getvalue()
    assert "10 of 10 frames" in text
    assert "[careful] a note" in text


def test_quiet_says_nothing() -> None:
    stream = Terminal()
    with Progress(stream, quiet=True) as progress:
        progress(1, 1)
        progress.say("x")
    assert stream.getvalue() == ""


def test_a_closed_stream_does_not_stop_the_run() -> None:
    progress = Progress(Broken())
    progress(10, 10)
    progress.say("x")
    progress.close()


def test_table_wraps_its_last_column(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "44")
    text = table([["a", "1", "one two three four five six seven"], ["long", "22", "x"]], right=(1,))
    assert text == ("  a      1  one two three four five six\n            seven\n  long  22  x")


def test_table_of_nothing() -> None:
    assert table([]) == ""


@pytest.mark.parametrize(("n", "text"), [(0, "0 stages"), (1, "1 stage"), (2, "2 stages")])
def test_plural(n: int, text: str) -> None:
    assert plural(n, "stage") == text


@pytest.mark.parametrize(
    ("key", "split"),
    [
        ("com_error_m", ("com error", "m")),
        ("joint_speed_rad_s", ("joint speed", "rad/s")),
        ("joint_jerk_rad_s3", ("joint jerk", "rad/s³")),
        ("slip_m_s", ("slip", "m/s")),
        ("held_frames", ("held", "frames")),
        ("ratio", ("ratio", "")),
        ("_m", (" m", "")),
    ],
)
def test_unit_of_a_figure(key: str, split: tuple[str, str]) -> None:
    assert split_unit(key) == split


def test_quality_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    metrics: dict[str, Any] = {
        "schema": "1",
        "figures": {
            "error_m": {"mean": 0.0123, "max": 0.0456, "frames": 90},
            "error_left_hand_m": {"mean": 0.5, "max": 1.25, "worst": "left", "frames": 90},
            "flight_frames": {"count": 9, "share": 0.1, "frames": 90},
            "margin_m": {"mean": math.nan, "min": -0.02, "max": 0.2, "frames": 3},
            "compute_time_s": 0.0005,
            "robot": {"fell": {"value": False, "frames": 90}, "notes": "text"},
        },
        "not_measured": {"x_m": "no contact"},
    }
    assert quality_table(metrics) == "\n".join(
        [
            "  figure           value   max  unit",
            "  error             12.3  45.6  mm      over 90 frames",
            "  error left hand    0.5  1.25  m       worst left, over 90 frames",
            "  flight               9        frames  10 %, over 90 frames",
            "  margin               -   0.2  m       min -0.02, over 3 frames",
            "  compute time       0.5        ms",
            "  robot fell          no                over 90 frames",
        ]
    )
    short = quality_table(metrics, short=True)
    assert "error left hand" not in short
    assert short.endswith("and 1 more figure in metrics.json")


def test_quality_table_of_nothing() -> None:
    assert quality_table({}) == "nothing was measured"
    assert quality_table({"figures": None}) == "nothing was measured"


@given(
    st.dictionaries(
        st.text(max_size=6),
        st.recursive(
            st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=4),
            lambda inner: (
                st.dictionaries(
                    st.sampled_from(["mean", "max", "frames", "value", "x_m", "count"]), inner, max_size=3
                )
                | st.lists(inner, max_size=2)
            ),
            max_leaves=6,
        ),
        max_size=4,
    )
)
def test_quality_table_takes_any_metrics(metrics: dict[str, Any]) -> None:
    assert isinstance(quality_table(metrics), str)
    assert isinstance(quality_table(metrics, short=True), str)


@pytest.mark.parametrize(
    ("annotation", "text"),
    [
        (float, "number"),
        (float | None, "number | null"),
        (list[str], "list of text"),
        (tuple[float, ...], "list of number"),
        (dict[str, int], "mapping to whole number"),
    ],
)
def test_types_in_plain_words(annotation: Any, text: str) -> None:
    assert type_text(annotation) == text
