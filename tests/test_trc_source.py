"""TRC files: written and read back, sloppy and broken ones, and the source."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from captured_people import in_unit, perform, small_trc
from imitor import testing
from imitor.errors import SourceError
from imitor.motion.marker_file import MarkerFile
from imitor.motion.trc_file import is_trc, read_trc, write_trc
from imitor.plugins.sources.trc import Trc

ROWS = ["1\t0.00\t1\t2\t3\t4\t5\t6", "2\t0.01\t\t\t\t4\t5\t7", "3\t0.02\t0\t0\t0\t4\t5\t8"]


def text(
    rows: list[str] = ROWS,
    *,
    head: str = "100\t100\t3\t2\tmm\t100\t1\t3",
    names: str = "A\t\t\tB\t\t",
    end: str = "\n",
) -> str:
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tC:\\somewhere\\a.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        head,
        f"Frame#\tTime\t{names}",
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
        "",
        *rows,
    ]
    return end.join(lines) + end


def read(folder: Path, content: str) -> MarkerFile:
    (folder / "a.trc").write_text(content, newline="")
    return read_trc(folder / "a.trc")


def test_what_is_written_is_read(tmp_path: Path) -> None:
    waving = in_unit(perform("wave", rate_hz=30.0, loss=0.1, seed=3).file, "mm", 0.001)
    write_trc(tmp_path / "a.trc", waving)
    again = read_trc(tmp_path / "a.trc")
    assert is_trc(tmp_path / "a.trc")
    assert (again.labels, again.rate_hz, again.unit, again.notes) == (waving.labels, 30.0, "mm", ())
    np.testing.assert_array_equal(again.seen, waving.seen)
    np.testing.assert_allclose(again.position, waving.position, atol=1e-6)


def test_empty_cells_and_zeros_are_lost(tmp_path: Path) -> None:
    file = read(tmp_path, text())
    assert file.labels == ("A", "B")
    assert file.seen.tolist() == [[True, True], [False, True], [False, True]]
    np.testing.assert_array_equal(file.position[:, 1], [[4, 5, 6], [4, 5, 7], [4, 5, 8]])


@pytest.mark.parametrize(
    "content",
    [
        text(end="\r\n"),
        text().replace("Z2\n\n", "Z2\n"),  # no empty line
        text(head="  100.0\t\t  100.0\t\t  3\t\t  2\t\t mm\t  100.0\t  1\t  3"),
        text(names=" A \t\t\t B\t\t\t"),
        text(names="A\t\tB").replace("Frame#\tTime\t", "Frame#\tTimes\t\t"),
        text([row + "\t" for row in ROWS]),
        text([row + " " for row in ROWS[:2]] + ["3\t0.02\tNaN\tnan\tNaN\t4\t5\t8"]),
        "\ufeff" + text(),
    ],
)
def test_sloppy_writers_are_understood(tmp_path: Path, content: str) -> None:
    file = read(tmp_path, content)
    assert (file.labels, file.rate_hz, file.unit) == (("A", "B"), 100.0, "mm")
    assert file.seen.tolist() == [[True, True], [False, True], [False, True]]


def test_rows_of_tabs_alone_are_frames(tmp_path: Path) -> None:
    file = read(tmp_path, text(["1\t0.00\t\t\t\t\t\t", *ROWS[1:]]))
    assert file.seen.tolist() == [[False, False], [False, True], [False, True]]


def test_a_header_that_errs_is_told(tmp_path: Path) -> None:
    file = read(tmp_path, text(head="100\t100\t2\t0\tmm\t100\t1\t2"))
    assert len(file.position) == 3
    assert file.notes == (
        "the header says 2 frames, the file holds 3",
        "the header says 0 markers, 2 are named",
    )


@pytest.mark.parametrize(
    ("content", "line", "said"),
    [
        ("", None, "the file is empty"),
        ("a\0b", None, "is not a text file"),
        ("HIERARCHY\n\n\n\n", 1, "a TRC file begins with 'PathFileType'"),
        ("PathFileType\t4\nDataRate", 2, "the file ends within its header"),
        (text().replace("DataRate\tCam", "Rate\tCam"), 2, "line 2 of a TRC file names DataRate"),
        (text(head="0\t0\t3\t2\tmm\t0\t1\t3"), 3, "DataRate is '0', not a number greater than 0"),
        (text(names=""), 4, "line 4 names no marker"),
        (text(names="A\t\t\tA\t\t"), 4, "line 4 names a marker twice: A"),
        (text().replace("Frame#", "Label"), 4, "line 4 of a TRC file begins with Frame# and Time"),
        (text([]), 6, "the file holds no frame"),
        (text([*ROWS[:2], "3\t0.02\t1\t2\tx3\t4\t5\t6"]), 9, "coordinate 3 is 'x3', not a number"),
        (text([*ROWS[:2], "3\t0.02\t1\t2\tinf\t4\t5\t6"]), 9, "coordinate 3 is not finite"),
        (text([ROWS[0], "2\t0.01\t1\t2\t3\t4", ROWS[2]]), 8, "4 coordinates, 2 markers have 6"),
        (text([*ROWS[:2], "3\t0.02\t1\t2"]), 9, "2 coordinates, 2 markers have 6: the file is cut off"),
        (text([ROWS[0] + "\t9\t9\t9", *ROWS[1:]]), 7, "9 coordinates, 2 markers have 6"),
        (text(ROWS[:2]), None, "the header promises 3 frames, the file holds 2: it is cut off"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, content: str, line: int | None, said: str) -> None:
    with pytest.raises(SourceError) as error:
        read(tmp_path, content)
    assert said in str(error.value)
    assert error.value.line == line


def test_a_name_that_is_not_utf8(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_bytes(text().replace("somewhere", "M\xfcller").encode("latin-1"))
    assert read_trc(tmp_path / "a.trc").labels == ("A", "B")


def test_it_keeps_the_contract_of_a_source(tmp_path: Path) -> None:
    testing.check_component(Trc, small_trc(tmp_path))


def test_the_time_column_may_be_rounded(tmp_path: Path) -> None:
    waving = replace(perform("wave", rate_hz=60.0).file, up="")
    write_trc(tmp_path / "a.trc", waving)
    lines = (tmp_path / "a.trc").read_text().split("\n")
    for i in range(6, len(lines) - 1):
        cells = lines[i].split("\t")
        lines[i] = "\t".join([cells[0], f"{float(cells[1]):.3f}", *cells[2:]])
    assert read(tmp_path, "\n".join(lines)).notes == ()
