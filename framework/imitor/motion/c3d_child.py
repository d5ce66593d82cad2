"""Read one C3D file with ezc3d and write what is needed as .npz: ``python c3d_child.py FILE.c3d OUT.npz``.

A process of its own, because ezc3d aborts the whole process on some damaged files. It imports nothing of imitor.
"""

from __future__ import annotations

import sys
from typing import Any

import ezc3d
import numpy as np

_COMPUTED = ("ANGLES", "MOMENTS", "FORCES", "POWERS", "SCALARS")
"""Parameters of POINT that list points which are no markers."""


def main(path: str, out: str) -> None:
    """Read and write."""
    c3d: Any = ezc3d.c3d(path)
    point = c3d["parameters"]["POINT"]

    def values(name: str) -> list[Any]:
        return list(point[name]["value"]) if name in point else []

    def listed(name: str) -> list[str]:
        more = sorted((k for k in point if k.startswith(name) and k[len(name) :].isdigit()), key=len)
        return [str(v).strip() for k in [name, *more] for v in values(k)]

    points = np.asarray(c3d["data"]["points"])  # (4, M, T), NaN where the residual is negative
    residual = np.asarray(c3d["data"]["meta_points"]["residuals"])[0]  # (M, T)
    position = np.moveaxis(points[:3], 0, -1).transpose(1, 0, 2).copy()  # (T, M, 3)
    position[residual.T < 0.0] = np.nan
    np.savez(
        out,
        position=position.astype(np.float32),
        labels=np.array(listed("LABELS"), dtype=str),
        computed=np.array([n for group in _COMPUTED for n in listed(group)], dtype=str),
        unit=np.array([str(v).strip() for v in values("UNITS")][:1], dtype=str),
        up=np.array([str(v).strip() for v in values("Y_SCREEN")][:1], dtype=str),
        rate_hz=np.array(float((values("RATE") or [0.0])[0])),
        first_frame=np.array(int(c3d["header"]["points"]["first_frame"]) + 1),
    )


if __name__ == "__main__":
    main(*sys.argv[1:3])
