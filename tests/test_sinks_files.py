"""Every file sink writes a small run, and what it wrote is read again."""

from __future__ import annotations

import contextlib
import csv
import importlib.util
import resource
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from imitor import Configuration, HumanFrame, Record, RunInfo, Skeleton, Support, TaskKind, TaskStack
from imitor.errors import SinkError
from imitor.record import Motion, Recorder, Reference
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.types import N_ROLES, ROLE_INDEX, ROLES

RATE_HZ = 60.0
SINKS = {
    "motion_file": {},
    "csv": {},
    "rerun": {},
    "video": {"size_px": (128, 96), "fps": 10.0, "sheet_width_px": 400, "columns": 2, "rows": 1},
}


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry(entry_points=False)


@pytest.fixture(scope="module")
def robot(registry: Registry) -> RobotModel:
    return RobotModel.load("unitree_g1", registry)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture(scope="module")
def can_render() -> None:
    """Skip where no picture can be rendered."""
    from imitor.visual.offscreen import check_rendering

    try:
        check_rendering()
    except SinkError as error:
        pytest.skip(str(error))


def standing_human() -> np.ndarray:
    """A human who stands at the origin and looks along x; no toe tips."""
    points = np.full((N_ROLES, 3), np.nan)
    heights = {"pelvis": 0.95, "chest": 1.2, "neck": 1.45, "head": 1.55, "head_top": 1.75}
    for role, z in heights.items():
        points[ROLE_INDEX[role]] = 0.0, 0.0, z
    sided = {
        "hip": (0.0, 0.1, 0.92), "knee": (0.02, 0.1, 0.5), "ankle": (0.0, 0.1, 0.08),
        "toe": (0.15, 0.1, 0.02), "heel": (-0.05, 0.1, 0.0), "shoulder": (0.0, 0.18, 1.42),
        "elbow": (0.0, 0.22, 1.14), "wrist": (0.0, 0.24, 0.88), "hand": (0.02, 0.24, 0.8),
    }  # fmt: skip
    for role, (x, y, z) in sided.items():
        points[ROLE_INDEX[f"left_{role}"]] = x, y, z
        points[ROLE_INDEX[f"right_{role}"]] = x, -y, z
    return points


class Play:
    """A run of a robot that sways beside a human who sways, and loses a hand for a while."""

    def __init__(
        self, robot: RobotModel, out: Path, n: int = 31, rate_hz: float = RATE_HZ, **info: Any
    ) -> None:
        stack = TaskStack(robot.n)
        stack.declare("left_hand", TaskKind.POSITION, frame="left_hand")
        stack.declare("right_foot", TaskKind.POSE, frame="right_foot", relative_to="left_foot")
        stack.declare("com", TaskKind.COM)
        stack.compile()
        skeleton = Skeleton("test", frozenset(ROLES), standing_human(), height_m=1.75)
        self.robot, self.n, self.rate_hz = robot, n, rate_hz
        self.info = RunInfo(out, robot, skeleton, rate_hz, stack, n, pipeline_name="sway", **info)

    def records(self) -> Iterator[Record]:
        """Yield the frames; the arrays are the same ones, written over, as in a real run."""
        stack, points = self.info.stack, standing_human()
        state = Configuration(self.robot.standing.copy(), np.ones(2, dtype=bool))
        position = points.copy()
        for i in range(self.n):
            time_s = i / self.rate_hz
            position[:] = points
            position[:, 1] += 0.05 * np.sin(2 * time_s)
            valid = np.isfinite(points).all(axis=1)
            valid[ROLE_INDEX["left_hand"]] = not 5 <= i < 10
            state.q[7:] = self.robot.standing[7:] + 0.1 * np.sin(3 * time_s)
            state.contact[:] = True, i < 20
            state.status = 1 if i == 12 else 0
            stack["left_hand"].target[:] = 0.3, 0.3, 0.9 + 0.01 * i
            stack["left_hand"].active[:] = i != 3
            human = HumanFrame(time_s, position, valid, com=position[0] + 0.0, support=Support(True, i < 20))
            yield Record(i, time_s, human, stack, state, compute_s=1e-4 * (i + 1))

    def into(self, sink: Any) -> Any:
        """Open a sink, write the run and return the report."""
        sink.start()
        sink.open(self.info)
        for record in self.records():
            sink.write(record)
        try:
            return sink.finish()
        finally:
            sink.close()

    def recorded(self) -> tuple[Motion, Reference]:
        """Return what a recorder keeps of the run."""
        recorder = Recorder(self.info)
        for record in self.records():
            recorder.add(record)
        return recorder.motion(), recorder.reference()


def make(registry: Registry, name: str, **options: Any) -> Any:
    cls = registry.get("sink", name)
    return cls(cls.config_type(**options))


# ---------------------------------------------------------------------- motion_file


def test_motion_file_gives_back_what_was_written(
    registry: Registry, robot: RobotModel, tmp_path: Path
) -> None:
    play = Play(robot, tmp_path)
    report = play.into(make(registry, "motion_file"))
    assert report.files == [tmp_path / "motion.npz", tmp_path / "reference.npz"]
    motion, reference = play.recorded()
    read = Motion.load(tmp_path / "motion.npz")
    np.testing.assert_array_equal(read.configurations(), motion.configurations())
    np.testing.assert_array_equal(read.contact, motion.contact)
    assert (read.joint_names, read.status, read.robot) == (motion.joint_names, motion.status, "unitree_g1")
    assert read.status[12] == "held" and set(read.status) == {"ok", "held"}
    ref = Reference.load(tmp_path / "reference.npz")
    np.testing.assert_array_equal(ref.role_position_m, reference.role_position_m)
    np.testing.assert_array_equal(ref.target["left_hand"][:, 2], 0.9 + 0.01 * np.arange(play.n))
    assert ref.target_active["left_hand"].tolist() == [i != 3 for i in range(play.n)]


def test_equal_runs_give_equal_bytes(registry: Registry, robot: RobotModel, tmp_path: Path) -> None:
    contents = []
    for name in ("a", "b"):
        out = tmp_path / name
        out.mkdir()
        files = [
            f for sink in ("motion_file", "csv") for f in Play(robot, out).into(make(registry, sink)).files
        ]
        contents.append([f.read_bytes() for f in files])
    assert contents[0] == contents[1] and len(contents[0]) == 3


def test_motion_file_leaves_the_reference_out(registry: Registry, robot: RobotModel, tmp_path: Path) -> None:
    report = Play(robot, tmp_path).into(make(registry, "motion_file", reference=False))
    assert [f.name for f in report.files] == ["motion.npz"]
    assert not (tmp_path / "reference.npz").exists()


# ---------------------------------------------------------------------- csv


@pytest.mark.parametrize("comment", [False, True])
def test_csv_is_a_table_with_units(
    registry: Registry, robot: RobotModel, tmp_path: Path, comment: bool
) -> None:
    play = Play(robot, tmp_path)
    (path,) = play.into(make(registry, "csv", path="table.csv", precision=9, comment=comment)).files
    lines = path.read_text(encoding="utf-8").splitlines()
    if comment:
        assert lines.pop(0) == "# robot unitree_g1, pipeline sway"
    rows = list(csv.DictReader(lines))
    assert len(rows) == play.n
    header = list(rows[0])
    assert header[:8] == [
        "time_s", "root_x_m", "root_y_m", "root_z_m", "root_qw", "root_qx", "root_qy", "root_qz"
    ]  # fmt: skip
    assert header[8:-3] == [f"{name}_rad" for name in robot.joint_names]
    assert header[-3:] == ["contact_left", "contact_right", "status"]
    motion, _ = play.recorded()
    table = np.array([[float(row[name]) for name in header[:-3]] for row in rows])
    expected = np.column_stack(
        [motion.time_s, motion.root_position_m, motion.root_quaternion_wxyz, motion.joint_position_rad]
    )
    np.testing.assert_allclose(table, expected, atol=0.6e-9)
    assert [row["contact_right"] for row in rows] == ["1" if i < 20 else "0" for i in range(play.n)]
    assert [row["status"] for row in rows] == motion.status


# ---------------------------------------------------------------------- rerun


def test_rerun_file_can_be_read_again(registry: Registry, robot: RobotModel, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    play = Play(robot, tmp_path)
    (path,) = play.into(make(registry, "rerun", path="x.rrd", max_hz=30.0)).files
    reader = RrdReader(path)
    rows: dict[str, int] = {}
    for chunk in reader.stream():
        if not chunk.is_static:
            rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    assert len(reader.blueprints()) == 1
    in_space = (play.n + 1) // 2
    assert rows["/world/robot"] == in_space * (robot.n + 1)  # a pose for each joint and the base
    for entity in ("human/bones", "human/joints", "targets", "com", "support_polygon"):
        assert rows[f"/world/{entity}"] == in_space, entity
    for entity in ("position_rad/left_leg", "times_ms/frame"):
        assert rows[f"/plots/{entity}"] == play.n, entity
    assert rows["/plots/speed_rad_s/right_arm"] == play.n - 1  # since the frame before
    assert rows["/plots/com_margin_m"] == in_space
    assert rows["/state/robot"] == 3  # ok, held, ok
    assert rows["/state/right_foot"] == 2


def test_rerun_shows_links_where_the_model_has_them(
    registry: Registry, robot: RobotModel, tmp_path: Path
) -> None:
    import pinocchio as pin
    from rerun.chunk import RrdReader

    play = Play(robot, tmp_path, n=3)
    (path,) = play.into(make(registry, "rerun", max_hz=1000.0)).files
    frames: dict[str, str] = {}
    last: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        named = {
            k.rpartition(":")[2]: batch.column(k).to_pylist()
            for k in batch.schema.names
            if k.startswith(("Transform3D:", "CoordinateFrame:"))
        }
        if "frame" in named:
            frames[chunk.entity_path] = named["frame"][0][0]
        if chunk.entity_path == "/world/robot" and "child_frame" in named:
            poses = zip(named["child_frame"], named["translation"], named["quaternion"], strict=True)
            last.update({c[0]: (np.array(t[0]), np.array(q[0])) for c, t, q in poses})
    *_, record = play.records()
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, record.state.q)
    knee = robot.model.getJointId("left_knee_joint")
    assert frames["/world/robot/left_knee_joint/part0"] in last
    assert set(frames.values()) == set(last)
    translation, quaternion = last[frames["/world/robot/left_knee_joint/part0"]]
    np.testing.assert_allclose(translation, data.oMi[knee].translation, atol=1e-6)
    np.testing.assert_allclose(quaternion, pin.SE3ToXYZQUAT(data.oMi[knee])[3:], atol=1e-6)


def test_rerun_view_needs_a_display(
    registry: Registry, robot: RobotModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imitor.visual.offscreen.headless", lambda: True)
    with pytest.raises(SinkError, match="no display here for the viewer; run without --view"):
        make(registry, "rerun").open(Play(robot, tmp_path, view=True).info)


# ---------------------------------------------------------------------- video


@pytest.mark.usefixtures("can_render")
def test_video_shows_every_picture(registry: Registry, robot: RobotModel, tmp_path: Path) -> None:
    from PIL import Image

    options = {**SINKS["video"], "path": "clip", "size_px": (160, 120)}
    gif, png = Play(robot, tmp_path).into(make(registry, "video", **options)).files
    assert (gif.name, png.name) == ("clip.gif", "clip.png")
    with Image.open(gif) as video:
        assert (video.n_frames, video.size, video.info["duration"]) == (6, (160, 120), 100)
        pictures = []
        for i in range(video.n_frames):
            video.seek(i)
            pictures.append(np.asarray(video.convert("RGB"), dtype=int))
    for picture in pictures:
        assert picture.std() > 10.0  # figures before a light ground
    assert np.abs(pictures[0] - pictures[-1]).max() > 50  # they move
    with Image.open(png) as sheet:
        assert sheet.width == 400 and 120 < sheet.height < 250
        assert np.asarray(sheet).std() > 10.0


@pytest.mark.usefixtures("can_render")
@pytest.mark.parametrize("layout", ["beside", "overlay"])
def test_both_figures_are_in_the_picture(
    registry: Registry, robot: RobotModel, tmp_path: Path, layout: str
) -> None:
    """The human's limbs have colours that the robot lacks; nothing is as dark as the robot's dark parts."""
    from PIL import Image

    options = {**SINKS["video"], "format": "none", "layout": layout, "title": "", "balance": False}
    (png,) = Play(robot, tmp_path).into(make(registry, "video", **options)).files
    with Image.open(png) as image:
        tile = np.asarray(image.convert("RGB"), dtype=int)[:, : image.width // 2]
    red, blue = tile[..., 0], tile[..., 2]
    warm, cool, dark = red - blue > 25, blue - red > 40, tile[40:].max(axis=2) < 60
    assert min(warm.sum(), cool.sum(), dark.sum()) > 20
    if layout == "beside":
        assert np.median(np.nonzero(warm | cool)[1]) < np.median(np.nonzero(dark)[1])


@pytest.mark.usefixtures("can_render")
@pytest.mark.parametrize(("rate_hz", "fps", "frames"), [(60.0, 30.0, 16), (60.0, 50.0, 26), (8.0, 25.0, 31)])
def test_a_gif_keeps_the_pace(
    registry: Registry, robot: RobotModel, tmp_path: Path, rate_hz: float, fps: float, frames: int
) -> None:
    from PIL import Image

    options = {**SINKS["video"], "fps": fps, "sheet": False, "size_px": (96, 96)}
    (gif,) = Play(robot, tmp_path, rate_hz=rate_hz).into(make(registry, "video", **options)).files
    with Image.open(gif) as video:
        assert video.n_frames == frames
        shown_ms = 0
        for i in range(video.n_frames):
            video.seek(i)
            shown_ms += video.info["duration"]
    last_ms = 1e3 / min(rate_hz, fps)
    assert shown_ms == pytest.approx(1e3 * 30 / rate_hz + last_ms, abs=10)


@pytest.mark.usefixtures("can_render")
def test_shadows_darken_the_picture(registry: Registry, robot: RobotModel, tmp_path: Path) -> None:
    from PIL import Image

    light = []
    for shadows in (True, False):
        options = {**SINKS["video"], "format": "none", "path": f"{shadows}", "shadows": shadows}
        (png,) = Play(robot, tmp_path, n=1).into(make(registry, "video", **options)).files
        with Image.open(png) as image:
            light.append(np.asarray(image.convert("L"), dtype=float).mean())
    assert light[0] < light[1] - 1.0


@pytest.mark.usefixtures("can_render")
def test_video_without_a_human(registry: Registry, robot: RobotModel, tmp_path: Path) -> None:
    play = Play(robot, tmp_path, n=3)
    sink = make(registry, "video", **SINKS["video"], format="none")
    sink.open(play.info)
    for record in play.records():
        record.human.valid = np.zeros(N_ROLES, dtype=bool)
        record.human.com = None
        sink.write(record)
    assert [f.name for f in sink.finish().files] == ["video.png"]


def test_video_says_when_nothing_can_be_rendered(
    registry: Registry, robot: RobotModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(
        SinkError, match=r"^no off-screen rendering here: .*install .*or take `use: video` out"
    ):
        make(registry, "video").open(Play(robot, tmp_path).info)


def test_mp4_says_what_to_install(
    registry: Registry, robot: RobotModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SinkError, match=r"pip install 'imageio\[ffmpeg\]', or choose format: gif"):
        make(registry, "video", format="mp4").open(Play(robot, tmp_path).info)


@pytest.mark.usefixtures("can_render")
def test_mp4_is_written(registry: Registry, robot: RobotModel, tmp_path: Path) -> None:
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        pytest.skip("imageio[ffmpeg] is not installed")
    import imageio

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # of the encoder's process
        mp4, _ = Play(robot, tmp_path).into(make(registry, "video", **SINKS["video"], format="mp4")).files
        with imageio.get_reader(mp4, format="FFMPEG") as reader:
            assert reader.count_frames() == 6 and reader.get_data(0).shape == (96, 128, 3)


def test_odd_sizes_are_refused(registry: Registry) -> None:
    with pytest.raises(ValidationError, match="even numbers from 64 to 4096"):
        make(registry, "video", size_px=(641, 480))


# ---------------------------------------------------------------------- every sink


@pytest.fixture(params=list(SINKS))
def sink(request: pytest.FixtureRequest, registry: Registry) -> Any:
    if request.param == "video":
        request.getfixturevalue("can_render")
    return make(registry, request.param, **SINKS[request.param])


def test_a_run_without_frames_leaves_nothing(sink: Any, robot: RobotModel, tmp_path: Path) -> None:
    report = Play(robot, tmp_path, n=0).into(sink)
    assert (report.files, report.figures, list(tmp_path.iterdir())) == ([], {}, [])


def test_one_frame_is_enough(sink: Any, robot: RobotModel, tmp_path: Path) -> None:
    report = Play(robot, tmp_path, n=1).into(sink)
    assert report.files and sorted(report.files) == sorted(tmp_path.iterdir())


def test_a_sink_leaves_the_run_alone(sink: Any, robot: RobotModel, tmp_path: Path) -> None:
    play = Play(robot, tmp_path, n=4)
    robot.update(robot.standing)
    before = robot.com.copy()
    sink.open(play.info)
    for record in play.records():
        record.human.position.flags.writeable = record.state.q.flags.writeable = False
        q, target = record.state.q.copy(), record.stack.flat_target.copy()
        sink.write(record)
        np.testing.assert_array_equal(record.state.q, q)
        np.testing.assert_array_equal(record.stack.flat_target, target)
        record.human.position.flags.writeable = record.state.q.flags.writeable = True
    sink.finish()
    np.testing.assert_array_equal(robot.com, before)


def test_a_folder_that_went_away(sink: Any, robot: RobotModel, tmp_path: Path) -> None:
    play = Play(robot, tmp_path / "run", n=2)
    play.info.out_dir.mkdir()
    sink.open(play.info)
    for record in play.records():
        sink.write(record)
    shutil.rmtree(play.info.out_dir)
    with pytest.raises(SinkError, match=r"^cannot write .*run/.*: No such file or directory; .*--out"):
        sink.finish()


@pytest.mark.parametrize("name", ["csv", "rerun", "video"])
def test_a_folder_that_never_was(name: str, registry: Registry, robot: RobotModel, tmp_path: Path) -> None:
    with pytest.raises(
        SinkError, match=rf"^sink '{name}': there is no folder .*/nowhere for .*option `path`"
    ):
        make(registry, name, path="nowhere/file").open(Play(robot, tmp_path).info)


@contextlib.contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Let the operating system refuse files above a size, as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_leaves_no_half_file(sink: Any, robot: RobotModel, tmp_path: Path) -> None:
    play = Play(robot, tmp_path)
    sink.open(play.info)
    for record in play.records():
        sink.write(record)
    with largest_file(2000), pytest.raises(SinkError, match=r"^cannot write .*make room"):
        sink.finish()
    assert list(tmp_path.iterdir()) == []
