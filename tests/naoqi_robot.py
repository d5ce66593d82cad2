"""A NAO in a process of its own, made of the real qi library: ``python naoqi_robot.py``.

Prints its address, then what it is told, one JSON value a line; ends when its standard input does. It imports nothing
of imitor. Options as JSON in the first argument: stiffness, moves (whether breathing can be switched), angle, deaf_s.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

os.environ["QI_LOG_LEVEL"] = "0"
import qi

_ARM = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw", "Hand")
_LEG = ("HipYawPitch", "HipRoll", "HipPitch", "KneePitch", "AnklePitch", "AnkleRoll")
_CHAINS = (("L", _ARM), ("L", _LEG), ("R", _LEG), ("R", _ARM))
BODY = ["HeadYaw", "HeadPitch", *(side + joint for side, chain in _CHAINS for joint in chain)]


def tell(*what: Any) -> None:
    print(json.dumps(what), flush=True)


class Motion:
    """The part of ALMotion that is used."""

    def __init__(self, options: dict[str, Any]) -> None:
        self._stiffness = options.get("stiffness", 1.0)
        self._body = [n for n in BODY if n not in options.get("without", ())]
        self._angles = dict.fromkeys(self._body, 0.0) | options.get("angles", {})
        self._deaf_s = options.get("deaf_s", 0.0)

    def getBodyNames(self, name: str) -> list[str]:
        return self._body

    def getAngles(self, names: list[str], use_sensors: bool) -> list[float]:
        tell("getAngles", use_sensors)
        return [self._angles[n] for n in names]

    def getStiffnesses(self, names: list[str]) -> list[float]:
        return [self._stiffness for _ in names]

    def wakeUp(self) -> None:
        tell("wakeUp")
        self._stiffness = 1.0

    def setIdlePostureEnabled(self, chain: str, on: bool) -> None:
        tell("setIdlePostureEnabled", chain, on)

    def setBreathEnabled(self, chain: str, on: bool) -> None:
        tell("setBreathEnabled", chain, on)

    def setAngles(self, names: list[str], angles: list[float], fraction: float) -> None:
        time.sleep(self._deaf_s)
        tell("setAngles", names, angles, fraction)


def main() -> None:
    session = qi.Session()
    session.listenStandalone("tcp://127.0.0.1:0")
    session.registerService("ALMotion", Motion(json.loads(sys.argv[1])))
    tell("at", session.endpoints()[0])
    sys.stdin.read()
    os._exit(0)  # qi's threads do not always end


if __name__ == "__main__":
    main()
