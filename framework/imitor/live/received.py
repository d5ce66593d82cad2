"""What a live run received, step by step: ``received.npz``. Its replay gives the same configurations bit for bit."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imitor.errors import SourceError
from imitor.kinds import Tick
from imitor.record import read_arrays, write_arrays
from imitor.rows import Rows
from imitor.safety.tracking import Request
from imitor.types import N_ROLES, ROLES, HumanFrame, Skeleton, Support, read_only

RECEIVED_FILE: Final = "received.npz"
SCHEMA: Final = "imitor-received-1"
_REQUESTS: Final = tuple(str(r) for r in Request)
_UNKNOWN: Final = -1
_OPTIONAL: Final = ("orientation", "marker", "marker_valid", "target", "target_valid")


def _row_shapes(like: HumanFrame | None) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Return shape and type of a row of each array, for frames like this one."""
    number, flag = np.float64, np.bool_
    out: dict[str, tuple[tuple[int, ...], Any]] = {
        "time_s": ((), number),
        "seen": ((), flag),
        "request": ((), np.int8),
        "position": ((N_ROLES, 3), number),
        "valid": ((N_ROLES,), flag),
        "com": ((3,), number),
        "support": ((2,), np.int8),
    }
    for name in _OPTIONAL:
        value = None if like is None else getattr(like, name)
        if value is not None:
            out[name] = (value.shape, value.dtype.type)
    return out


class ReceivedRecorder:
    """Collects the steps of a live run.

    Args:
        skeleton: The person.
        rate_hz: Steps per second [Hz].
        calibrated_with: Frames that stages were calibrated with.
        folder: Where the steps are kept until `save`.
    """

    def __init__(
        self, skeleton: Skeleton, rate_hz: float, calibrated_with: Sequence[HumanFrame], folder: Path
    ) -> None:
        self._skeleton, self._rate_hz, self._folder = skeleton, rate_hz, folder
        self._rows: Rows | None = None
        self._before: list[Tick] = []  # steps before the first frame, which tells what frames hold
        self._first = Rows(_row_shapes(calibrated_with[0] if calibrated_with else None))
        for frame in calibrated_with:
            _put(self._first, Tick(frame.time_s, frame))

    def add(self, tick: Tick) -> None:
        """Copy one step."""
        if self._rows is None:
            if tick.frame is None:
                self._before.append(tick)
                return
            self._begin(tick.frame)
        if self._rows is not None:
            _put(self._rows, tick)

    def _begin(self, like: HumanFrame | None) -> Rows:
        self._rows = Rows(_row_shapes(like), folder=self._folder)
        for tick in self._before:
            _put(self._rows, tick)
        return self._rows

    def save(self, path: Path) -> None:
        """Write the file; it appears whole or not at all."""
        head = {
            "schema": np.array(SCHEMA),
            "rate_hz": np.array(self._rate_hz),
            "role_names": np.array(ROLES),
            "skeleton": np.array(json.dumps(_facts(self._skeleton))),
            "rest_position": self._skeleton.rest_position,
        }
        first = {f"calibration/{n}": a for n, a in self._first.arrays().items()}
        rows = self._begin(None) if self._rows is None else self._rows
        write_arrays(path, head | first | rows.arrays())

    def close(self) -> None:
        """Give the disk space back."""
        if self._rows is not None:
            self._rows.close()


def _put(rows: Rows, tick: Tick) -> None:
    arrays, i = rows.next()
    arrays["time_s"][i], arrays["request"][i] = tick.time_s, _REQUESTS.index(tick.request)
    frame = tick.frame
    arrays["seen"][i] = frame is not None
    if frame is None:
        return
    arrays["position"][i], arrays["valid"][i] = frame.position, frame.valid
    arrays["com"][i] = np.nan if frame.com is None else frame.com
    support = frame.support
    arrays["support"][i] = _UNKNOWN if support is None else (support.left, support.right)
    for name in _OPTIONAL:
        value = getattr(frame, name)
        if name in arrays and value is not None:
            arrays[name][i] = value


def _facts(skeleton: Skeleton) -> dict[str, Any]:
    facts = {f.name: getattr(skeleton, f.name) for f in fields(skeleton) if f.name != "rest_position"}
    facts["roles"] = sorted(skeleton.roles)
    facts["marker_segments"] = {k: list(v) for k, v in skeleton.marker_segments.items()}
    return {k: list(v) if isinstance(v, tuple) else v for k, v in facts.items()}


class Received:
    """A recorded live run.

    Args:
        path: A ``received.npz``.

    Attributes:
        skeleton: The person.
        rate_hz: Steps per second [Hz].

    Raises:
        SourceError: The file is missing, damaged or of another schema.
    """

    def __init__(self, path: Path) -> None:
        data = read_arrays(path)
        try:
            if str(data["schema"]) != SCHEMA:
                raise SourceError(path, f"schema '{data['schema']}', expected '{SCHEMA}'")
            if data["role_names"].tolist() != list(ROLES):
                raise SourceError(path, "its points are not those of this version of imitor; record it again")
            self.rate_hz = float(data["rate_hz"])
            self.skeleton = _skeleton(data)
            self._steps, self._first = _part(data, ""), _part(data, "calibration/")
            _check(path, self._steps)
            _check(path, self._first)
        except KeyError as error:
            raise SourceError(path, f"the array {error} is missing") from None
        except (ValueError, TypeError) as error:
            raise SourceError(path, f"is damaged: {error}") from None

    def __len__(self) -> int:
        return len(self._steps["time_s"])

    @property
    def calibrated_with(self) -> Iterator[HumanFrame]:
        """The frames that stages were calibrated with."""
        return (t.frame for t in _ticks(self._first) if t.frame is not None)

    def ticks(self) -> Iterator[Tick]:
        """Yield the steps."""
        return _ticks(self._steps)


def _part(data: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    needed = ("time_s", "seen", "request", "position", "valid", "com", "support")
    names = [*needed, *(n for n in _OPTIONAL if prefix + n in data)]
    return {n: read_only(data[prefix + n]) for n in names}


def _check(path: Path, part: Mapping[str, NDArray[Any]]) -> None:
    shapes, n = _row_shapes(None), len(part["time_s"])
    for name, array in part.items():
        shape, kind = shapes.get(name, (array.shape[1:], array.dtype.type))
        if array.shape != (n, *shape) or array.dtype != kind:
            raise SourceError(path, f"is damaged: the array {name} has {array.dtype} of shape {array.shape}")
    if not np.isin(part["request"], range(len(_REQUESTS))).all():
        raise SourceError(path, "is damaged: a request in it is unknown")


def _skeleton(data: Mapping[str, NDArray[Any]]) -> Skeleton:
    facts = json.loads(str(data["skeleton"]))
    facts["roles"] = frozenset(facts["roles"])
    return Skeleton(rest_position=data["rest_position"], **facts)


def _ticks(part: Mapping[str, NDArray[Any]]) -> Iterator[Tick]:
    for i in range(len(part["time_s"])):
        time_s, request = float(part["time_s"][i]), _REQUESTS[part["request"][i]]
        if not part["seen"][i]:
            yield Tick(time_s, None, request)
            continue
        frame = HumanFrame(time_s, part["position"][i], part["valid"][i])
        for name in _OPTIONAL:
            if name in part:
                setattr(frame, name, part[name][i])
        if np.isfinite(part["com"][i]).all():
            frame.com = part["com"][i]
        left, right = part["support"][i]
        if left != _UNKNOWN:
            frame.support = Support(bool(left), bool(right))
        yield Tick(time_s, frame, request)


__all__ = ["RECEIVED_FILE", "SCHEMA", "Received", "ReceivedRecorder"]
