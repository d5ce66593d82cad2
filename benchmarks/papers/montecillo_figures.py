"""Figures 4 and 5 of Montecillo-Puente et al. (ICINCO 2010): the dance and the foot lift."""

from __future__ import annotations

from typing import Any

import numpy as np
from experiment import Played
from montecillo_errors import roll_pitch_yaw, turn_of
from page import strips

from imitor.types import SIDES
from imitor.visual.panels import BLUE, GREEN, GREY, INK, RED, Line, Panel, mixed


def poses(p: Played) -> Any:
    """Return human and robot side by side at six times."""
    from imitor.visual.palette import reduced
    from imitor.visual.sheet import contact_sheet, tile_size
    from imitor.visual.studio import Studio

    rows = np.linspace(len(p.run) // 6, len(p.run) - 1, 6).round().astype(int)
    width, height = tile_size((400, 440), 6, 1500)
    studio = Studio(p.robot, p.motion, p.reference, rows, size=(2 * width, 2 * height))
    try:
        pictures = [studio.picture(i) for i in range(len(studio))]
    finally:
        studio.close()
    return reduced(contact_sheet(pictures, p.time_s[rows].tolist(), "", 6, 1500))


def angles(p: Played) -> list[Panel]:
    """Return roll, pitch and yaw of head and chest over time."""
    out = []
    for part in ("head", "chest"):
        asked, robot = (roll_pitch_yaw(R) for R in (turn_of(p, part), p.frame(part)[:, :3, :3]))
        for axis, name in enumerate(("roll", "pitch", "yaw")):
            lines = [
                Line(p.time_s, asked[:, axis], "HN model", INK),
                Line(p.time_s, robot[:, axis], "robot", RED, dashed=True),
            ]
            out.append(Panel(f"{part}, {name}", "time [s]", "[deg]", lines))
    return out


def lift_panels(p: Played) -> list[Panel]:
    """Return head, CoM and its target sideways, and the heights of both feet."""
    t, soles = p.time_s, p.run.path.sole
    sideways = [
        Line(t, p.observed[:, 1], "head of the HN model", INK),
        Line(t, p.reference.target["com"][:, 1], "CoM, target", mixed(BLUE, 0.4), width_px=6.0),
        Line(t, p.run.path.com[:, 1], "CoM of the robot", BLUE, dashed=True),
        *(Line(t, soles[:, i, :, 1].mean(axis=1), f"{SIDES[i]} sole", GREY, dashed=True) for i in range(2)),
    ]
    heights = [
        Line(t, soles[:, i, :, 2].min(axis=1), f"{SIDES[i]} sole", colour)
        for i, colour in enumerate((RED, GREEN))
    ]
    return [
        Panel("Sideways", "time [s]", "y [m]", sideways, strips=strips(p)),
        Panel("Lowest corner of the soles", "time [s]", "z [m]", heights, strips=strips(p)),
    ]
