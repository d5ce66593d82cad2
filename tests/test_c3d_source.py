"""C3D files: written and read back, damaged in every way that occurs, and the source."""

from __future__ import annotations

import importlib.util
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from captured_people import in_unit, perform, small_c3d
from imitor import testing
from imitor.errors import SourceError
from imitor.motion.c3d_file import check_header, read_c3d, write_c3d
from imitor.motion.marker_file import MarkerFile
from imitor.plugins.sources.c3d import C3d, C3dConfig

pytest.importorskip("ezc3d")


@pytest.fixture(scope="module")
def waving() -> MarkerFile:
    return in_unit(perform("wave", rate_hz=30.0, loss=0.1, seed=3).file, "mm", 0.001)


@pytest.fixture
def file(waving: MarkerFile, tmp_path: Path) -> Path:
    path = tmp_path / "wave.c3d"
    write_c3d(path, waving)
    return path


def test_what_is_written_is_read(waving: MarkerFile, file: Path) -> None:
    again = read_c3d(file)
    assert again.labels == waving.labels
    assert (again.rate_hz, again.unit, again.up, again.first_frame) == (30.0, "mm", "z", 1)
    np.testing.assert_array_equal(again.seen, waving.seen)
    assert (~waving.seen).sum() > 0
    np.testing.assert_allclose(again.position, waving.position, rtol=1e-6)


def test_a_clip_keeps_its_first_frame(waving: MarkerFile, tmp_path: Path) -> None:
    write_c3d(tmp_path / "cut.c3d", replace(waving, first_frame=704))
    again = read_c3d(tmp_path / "cut.c3d")
    assert (again.first_frame, len(again.position)) == (704, len(waving.position))


@pytest.mark.parametrize(("unit", "up"), [("m", ""), ("mm", "-y"), ("cm", "x")])
def test_unit_and_axis_are_those_of_the_file(waving: MarkerFile, tmp_path: Path, unit: str, up: str) -> None:
    write_c3d(tmp_path / "a.c3d", replace(waving, unit=unit, up=up))
    again = read_c3d(tmp_path / "a.c3d")
    assert (again.unit, again.up) == (unit, up)


def test_points_without_name_and_stars_are_left_out(waving: MarkerFile, tmp_path: Path) -> None:
    labels = tuple("*7" if label == "C7" else label for label in waving.labels)
    write_c3d(tmp_path / "a.c3d", replace(waving, labels=labels))
    again = read_c3d(tmp_path / "a.c3d")
    assert len(again.labels) == len(waving.labels) - 1
    assert "C7" not in again.labels and "*7" not in again.labels


def patched(at: int, data: bytes) -> Callable[[bytes], bytes]:
    return lambda whole: whole[:at] + data + whole[at + len(data) :]


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda b: b"", "the file is empty"),
        (lambda b: b[:100], "is no C3D file: the second byte of one is 0x50, and its header has 512 bytes"),
        (lambda b: b"PK\x03\x04" + b[4:], "is no C3D file: the second byte of one is 0x50"),
        (lambda b: b[:700], "the header promises"),
        (lambda b: b[:-1000], "it is cut off"),
        (patched(2, struct.pack("<H", 0)), "the file holds no points"),
        (patched(6, struct.pack("<2H", 9, 3)), "the header counts frames from 9 to 3: there are none"),
        (patched(512 + 3, bytes([7])), "its parameters should begin at block 2"),
        (patched(0, bytes([200])), "its parameters should begin at block 200"),
    ],
)
def test_damaged_files_are_refused(file: Path, damage: Callable[[bytes], bytes], said: str) -> None:
    file.write_bytes(damage(file.read_bytes()))
    with pytest.raises(SourceError) as error:
        read_c3d(file)
    assert str(error.value).startswith(f"{file}: ") and said in str(error.value)


def test_a_cut_file_says_how_much_is_there(waving: MarkerFile, file: Path) -> None:
    whole, frames = file.read_bytes(), len(waving.position)
    header = check_header(file)
    per_frame = 4 * 4 * len(waving.labels)
    assert header.frames == frames
    file.write_bytes(whole[: (header.data_block - 1) * 512 + 10 * per_frame + 5])
    with pytest.raises(
        SourceError, match=rf"promises {frames} frames in \d+ bytes, .* 10 frames: it is cut off"
    ):
        read_c3d(file)


def test_a_reader_that_dies_is_a_message(file: Path) -> None:
    # Parameters full of nonsense: whatever happens in the reader's process, ours goes on.
    whole = bytearray(file.read_bytes())
    whole[516:900] = bytes([255, 1] * 192)
    file.write_bytes(bytes(whole))
    with pytest.raises(
        SourceError, match=r"ezc3d cannot read it|POINT:RATE|no marker set|could be read|names no"
    ):
        source = C3d(C3dConfig(path=str(file)))
        source.start()


@settings(max_examples=12, deadline=None)
@given(place=st.integers(0, 4000), value=st.integers(0, 255))
def test_one_wrong_byte_never_takes_us_down(
    place: int, value: int, waving: MarkerFile, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "one_byte.c3d"
    write_c3d(path, replace(waving, position=waving.position[:4]))
    whole = bytearray(path.read_bytes())
    whole[place % len(whole)] = value
    path.write_bytes(bytes(whole))
    try:
        read_c3d(path)
    except SourceError as error:
        assert str(error).startswith(str(path))


def test_without_the_reader_it_says_what_to_install(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == "ezc3d" else find(n))
    with pytest.raises(SourceError) as error:
        read_c3d(file)
    assert str(error.value).endswith("which is not installed: pip install 'imitor[c3d]'")


def test_there_is_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="there is no such file"):
        read_c3d(tmp_path / "none.c3d")
    with pytest.raises(SourceError, match="is a folder"):
        read_c3d(tmp_path)


def test_it_keeps_the_contract_of_a_source(tmp_path: Path) -> None:
    testing.check_component(C3d, small_c3d(tmp_path))
