"""What Unitree's humanoids of the family "hg" (G1, H1-2) speak on DDS: two messages and a checksum.

The types are declared for cyclonedds; a checksum that is wrong makes the robot ignore a command without a word.
"""

# No `from __future__ import annotations`: cyclonedds reads the types of the fields.
import struct
import zlib
from dataclasses import dataclass
from typing import Any, Final

from cyclonedds import idl
from cyclonedds.idl import annotations as annotate
from cyclonedds.idl.types import array, float32, int16, uint8, uint32

N_MOTORS: Final = 35
"""Motors in a message, however many the robot has."""
_IN_MEMORY: Final = struct.Struct("<2B2x" + N_MOTORS * "B3x5fI" + "5I")
"""A command as the robot's processor holds it, over which the checksum is taken."""
_ON_THE_WIRE: Final = struct.Struct("<2BBx5fI" + (N_MOTORS - 1) * "B3x5fI" + "5I")
"""A command in CDR, where a motor begins without a gap."""
_HEADER: Final = b"\x00\x01\x00\x00"
"""Little-endian CDR of version 1."""
_ONES: Final = 0xFFFFFFFF
_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


@dataclass
@annotate.final
@annotate.autoid("sequential")
class MotorCmd_(idl.IdlStruct, typename="unitree_hg.msg.dds_.MotorCmd_"):  # type: ignore[misc, call-arg]
    """What one motor is told: torque = tau + kp (q - measured) + kd (dq - measured) [N m]."""

    mode: uint8  # 1: on
    q: float32  # [rad]
    dq: float32  # [rad/s]
    tau: float32  # [N m]
    kp: float32  # [N m/rad]
    kd: float32  # [N m s/rad]
    reserve: uint32


@dataclass
@annotate.final
@annotate.autoid("sequential")
class LowCmd_(idl.IdlStruct, typename="unitree_hg.msg.dds_.LowCmd_"):  # type: ignore[misc, call-arg]
    """What all motors are told."""

    mode_pr: uint8  # 0: ankles by pitch and roll
    mode_machine: uint8  # as the robot tells
    motor_cmd: array[MotorCmd_, N_MOTORS]
    reserve: array[uint32, 4]
    crc: uint32

    def serialize(
        self, buffer: Any = None, endianness: Any = None, use_version_2: bool | None = None
    ) -> bytes:
        """Return the message as bytes. One call where cyclonedds goes from field to field in Python."""
        if buffer is not None or endianness is not None or use_version_2:
            return bytes(super().serialize(buffer, endianness, use_version_2))
        return _HEADER + _ON_THE_WIRE.pack(*self.values(), self.crc)

    def values(self) -> list[Any]:
        """Return all fields but the checksum, motor after motor."""
        out: list[Any] = [self.mode_pr, self.mode_machine]
        for m in self.motor_cmd:
            out += (m.mode, m.q, m.dq, m.tau, m.kp, m.kd, m.reserve)
        return out + list(self.reserve)


@dataclass
@annotate.final
@annotate.autoid("sequential")
class IMUState_(idl.IdlStruct, typename="unitree_hg.msg.dds_.IMUState_"):  # type: ignore[misc, call-arg]
    """The inertial unit."""

    quaternion: array[float32, 4]  # w x y z
    gyroscope: array[float32, 3]
    accelerometer: array[float32, 3]
    rpy: array[float32, 3]
    temperature: int16


@dataclass
@annotate.final
@annotate.autoid("sequential")
class MotorState_(idl.IdlStruct, typename="unitree_hg.msg.dds_.MotorState_"):  # type: ignore[misc, call-arg]
    """What one motor tells."""

    mode: uint8
    q: float32
    dq: float32
    ddq: float32
    tau_est: float32
    temperature: array[int16, 2]
    vol: float32
    sensor: array[uint32, 2]
    motorstate: uint32
    reserve: array[uint32, 4]


@dataclass
@annotate.final
@annotate.autoid("sequential")
class LowState_(idl.IdlStruct, typename="unitree_hg.msg.dds_.LowState_"):  # type: ignore[misc, call-arg]
    """What the robot tells."""

    version: array[uint32, 2]
    mode_pr: uint8
    mode_machine: uint8
    tick: uint32
    imu_state: IMUState_
    motor_state: array[MotorState_, N_MOTORS]
    wireless_remote: array[uint8, 40]
    reserve: array[uint32, 4]
    crc: uint32


def new_command() -> LowCmd_:
    """Return a command that moves nothing."""
    return LowCmd_(0, 0, [MotorCmd_(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0) for _ in range(N_MOTORS)], [0] * 4, 0)


def crc32_mpeg2(data: bytes) -> int:
    """Return the CRC-32/MPEG-2 of bytes: polynomial 04C11DB7, from all ones, nothing mirrored or inverted.

    It is zlib's CRC of the mirrored bytes, itself mirrored, without its last inversion.
    """
    return int(f"{zlib.crc32(data.translate(_MIRRORED)) ^ _ONES:032b}"[::-1], 2)


def checksum(command: LowCmd_) -> int:
    """Return what the field ``crc`` of a command has to be: over its 32-bit words but the last, high byte first."""
    packed = _IN_MEMORY.pack(*command.values(), 0)[:-4]
    words = len(packed) // 4
    return crc32_mpeg2(struct.pack(f">{words}I", *struct.unpack(f"<{words}I", packed)))


__all__ = [
    "N_MOTORS", "IMUState_", "LowCmd_", "LowState_", "MotorCmd_", "MotorState_", "checksum", "crc32_mpeg2",
    "new_command",
]  # fmt: skip
