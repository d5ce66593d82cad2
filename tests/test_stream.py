"""Playing a recording on the network: the schedule without a clock, the sender with a false one, the command."""

from __future__ import annotations

import io
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imitor.cli import main
from imitor.errors import ImitorError
from imitor.live.stream import Departure, Instant, Network, Sent, departures, instants, send
from imitor.testing.live import Played
from imitor.types import HumanFrame
from live_tools import heeds_interrupts

PERIOD_S = 0.01


def told(n: int, parts: int = 1) -> Iterator[Instant]:
    for i in range(n):
        yield Instant(i * PERIOD_S, [f"{i}.{k}".encode() for k in range(parts)])


def names(leaving: Sequence[Departure]) -> list[str]:
    return [d.datagram.decode() for d in leaving]


# ---------------------------------------------------------------- what leaves when


def test_a_sound_network_changes_nothing() -> None:
    sent = Sent()
    leaving = list(departures(told(50, 2), Network(), PERIOD_S, sent))
    assert names(leaving) == [f"{i}.{k}" for i in range(50) for k in range(2)]
    assert [d.at_s for d in leaving] == [i * PERIOD_S for i in range(50) for _ in range(2)]
    assert sent == Sent(instants=50)


def test_what_is_lost_does_not_leave() -> None:
    sent = Sent()
    leaving = list(departures(told(2000), Network(loss=0.1, seed=3), PERIOD_S, sent))
    assert len(leaving) + sent.lost == 2000
    assert 150 < sent.lost < 250
    assert list(departures(told(20), Network(loss=1.0), PERIOD_S)) == []


def test_the_same_are_lost_whatever_the_jitter() -> None:
    calm = names(list(departures(told(300), Network(loss=0.2, seed=5), PERIOD_S)))
    rough = names(list(departures(told(300), Network(loss=0.2, jitter_s=0.004, seed=5), PERIOD_S)))
    other = names(list(departures(told(300), Network(loss=0.2, seed=6), PERIOD_S)))
    assert calm == rough != other


def test_jitter_delays_and_keeps_the_order() -> None:
    leaving = list(departures(told(500), Network(jitter_s=0.05, seed=1), PERIOD_S))
    assert names(leaving) == [f"{i}.0" for i in range(500)]
    delays = [d.at_s - i * PERIOD_S for i, d in enumerate(leaving)]
    assert min(delays) >= 0.0 and 0.03 < max(delays) <= 0.05


def test_who_is_reordered_is_overtaken() -> None:
    sent = Sent()
    leaving = names(list(departures(told(500), Network(reorder=0.05, jitter_s=0.02, seed=1), PERIOD_S, sent)))
    assert sorted(leaving, key=lambda n: int(n[:-2])) == [f"{i}.0" for i in range(500)]
    overtaken = [n for i, n in enumerate(leaving) if any(int(m[:-2]) > int(n[:-2]) for m in leaving[:i])]
    assert 10 < 0.8 * sent.reordered < len(overtaken) <= sent.reordered  # two in a row may keep their order


def test_duplicates_come_twice() -> None:
    sent = Sent()
    leaving = names(list(departures(told(500), Network(duplicate=0.1, seed=2), PERIOD_S, sent)))
    assert len(leaving) == 500 + sent.duplicated
    assert set(leaving) == {f"{i}.0" for i in range(500)}
    assert 20 < sent.duplicated < 90


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0, 1),
    st.floats(0, 0.1),
    st.floats(0, 1),
    st.floats(0, 1),
    st.integers(0, 1000),
    st.integers(1, 3),
)
def test_nothing_is_invented_and_time_goes_forward(
    loss: float, jitter_s: float, reorder: float, duplicate: float, seed: int, parts: int
) -> None:
    network, sent = Network(loss, jitter_s, reorder, duplicate, seed), Sent()
    leaving = list(departures(told(60, parts), network, PERIOD_S, sent))
    times = [d.at_s for d in leaving]
    assert times == sorted(times)
    assert len(leaving) == 60 * parts - sent.lost + sent.duplicated
    assert set(names(leaving)) <= {f"{i}.{k}" for i in range(60) for k in range(parts)}
    assert leaving == list(departures(told(60, parts), network, PERIOD_S))


# ---------------------------------------------------------------- the instants of a recording


class Clock:
    """Encodes the sender's clock and count."""

    def encode(self, frame: HumanFrame, counter: int) -> list[bytes]:
        return [f"{counter} {frame.time_s:.4f}".encode()]


def clock_of(**options: Any) -> list[tuple[float, int, float]]:
    played = Played("stand", rate_hz=30.0)
    played.start()
    out = []
    for instant in instants(played, Clock(), **options):
        counter, time_s = instant.datagrams[0].split()
        out.append((instant.time_s, int(counter), float(time_s)))
    return out


def test_a_recording_is_told_once() -> None:
    played = Played("stand", rate_hz=30.0)
    played.start()
    heard = clock_of()
    assert len(heard) == played.n_frames
    assert [c for _, c, _ in heard] == list(range(len(heard)))
    for at_s, counter, time_s in heard:
        assert at_s == pytest.approx(counter / 30.0) == pytest.approx(time_s, abs=1e-4)


def test_half_the_speed_takes_twice_the_time() -> None:
    whole, slow = clock_of(), clock_of(speed=0.5)
    assert len(slow) == len(whole)
    assert slow[-1][0] == pytest.approx(2 * whole[-1][0])
    assert slow[-1][2] == pytest.approx(2 * whole[-1][2], abs=1e-3)


def test_another_rate() -> None:
    whole, fast = clock_of(), clock_of(rate_hz=100.0, speed=2.0)
    assert fast[7][0] == pytest.approx(0.07)
    assert fast[-1][0] == pytest.approx(whole[-1][0] / 2, abs=0.01)


def test_clock_and_count_go_on_over_the_end() -> None:
    once = clock_of()
    n = len(once)
    again = clock_of(loop=True, seconds=2.5 * n / 30.0)
    assert len(again) == pytest.approx(2.5 * n, abs=1)
    assert [c for _, c, _ in again] == list(range(len(again)))
    for at_s, counter, _ in again:
        assert at_s == pytest.approx(counter / 30.0)


# ---------------------------------------------------------------- the sender


@dataclass
class FalseTime:
    """A clock that advances by waiting, and a little by being looked at."""

    now: float = 100.0
    naps: list[float] = field(default_factory=list)

    def clock(self) -> float:
        self.now += 1e-5
        return self.now

    def sleep(self, seconds: float) -> None:
        self.naps.append(seconds)
        self.now += seconds + 5e-5


class FalseSocket:
    """Notes what is sent, and takes long over one datagram."""

    def __init__(self, time: FalseTime) -> None:
        self.time = time
        self.sent: list[tuple[float, bytes]] = []

    def sendto(self, datagram: bytes, address: tuple[Any, ...]) -> None:
        self.sent.append((self.time.now - 100.0, datagram))
        self.time.now += 0.035 if len(self.sent) == 10 else 0.0


def test_the_sender_keeps_absolute_time() -> None:
    time, sent, seen = FalseTime(), Sent(), list[float]()
    sock = FalseSocket(time)
    leaving = departures(told(200), Network(), PERIOD_S, sent)
    send(leaving, sock, ("h", 1), sent, watch=seen.append, clock=time.clock, sleep=time.sleep)  # type: ignore[arg-type]
    late = [at_s - i * PERIOD_S for i, (at_s, _) in enumerate(sock.sent)]
    assert all(x > 0 for x in late)
    assert max(late[:10]) < 1e-4  # never early, hardly late
    assert late[10] == pytest.approx(0.025, abs=1e-3)  # the one that took long holds up the next
    assert max(late[15:]) < 1e-4  # but nothing after it
    assert (sent.instants, sent.datagrams, sent.bytes) == (200, 200, sum(len(d) for _, d in sock.sent))
    assert sent.latest_s == pytest.approx(0.025, abs=1e-3)
    assert seen == [i * PERIOD_S for i in range(200)]


def test_what_cannot_be_sent_is_said() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        leaving = [Departure(0.0, bytes(70000))]
        with pytest.raises(
            ImitorError, match=r"^cannot send 70000 bytes to 127\.0\.0\.1:9: Message too long$"
        ):
            send(leaving, sock, ("127.0.0.1", 9), Sent())


# ---------------------------------------------------------------- the command

STAND = ("--source", "performer", "--set", "source.scenario=stand", "--as", "joints_udp")


def call(capsys: pytest.CaptureFixture[str], *argv: str) -> tuple[int, str]:
    status = main(["stream", *argv])
    out, err = capsys.readouterr()
    assert out == ""
    return status, err


def test_it_plays_to_a_port(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(5.0)
        port = sock.getsockname()[1]
        status, err = call(capsys, *STAND, "--to", f"127.0.0.1:{port}", "--seconds", "0.2", "--rate", "50")
        heard = [sock.recv(65535) for _ in range(10)]
    first, last = err.splitlines()
    where = f"as joints_udp to 127.0.0.1:{port}"
    assert status == 0
    assert first == f"sending 6.0 s at 50 Hz {where}; Ctrl-C ends it"
    kilobytes = f"{sum(map(len, heard)) / 1000:.0f}"
    assert last.startswith(f"sent 10 instants {where}: 10 datagrams, {kilobytes} kB; at most ")
    assert [b'"counter":%d,' % i in d for i, d in enumerate(heard)] == [True] * 10


def test_prepared_datagrams_are_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(5.0)
        argv = (*STAND, "--to", f"127.0.0.1:{sock.getsockname()[1]}", "--seconds", "0.2", "--loop")
        assert call(capsys, *argv, "--quiet")[0] == 0
        status, err = call(capsys, *argv, "--prepare")
        heard = [sock.recv(65535) for _ in range(48)]
    assert status == 0
    assert "\npreparing all datagrams ...\nprepared 24 instants" in err
    assert heard[:24] == heard[24:]


def test_it_can_be_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, *STAND, "--to", "127.0.0.1:9", "--seconds", "0.05", "--quiet") == (0, "")


def test_what_chance_did_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    _, err = call(capsys, *STAND, "--to", "127.0.0.1:9", "--seconds", "0.1", "--loss", "100")
    assert "sent 12 instants as joints_udp to 127.0.0.1:9: 0 datagrams, 0 kB (12 lost); at most" in err


class Terminal(io.StringIO):
    """A terminal, as far as one asks."""

    def isatty(self) -> bool:
        return True


class BrokenTerminal(Terminal):
    """A terminal that is gone once a line is drawn on it."""

    def write(self, text: str) -> int:
        if text.startswith("\r"):
            raise OSError("gone")
        return super().write(text)


def test_a_terminal_shows_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert main(["stream", *STAND, "--to", "127.0.0.1:9", "--seconds", "0.5", "--rate", "50"]) == 0
    text = terminal.getvalue()
    assert "\r     0.2 s  11 instants  10 datagrams\x1b[K" in text
    assert "\r\x1b[Ksent 25 instants" in text  # the line is wiped before the summary


def test_a_terminal_that_is_gone_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = BrokenTerminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert main(["stream", *STAND, "--to", "127.0.0.1:9", "--seconds", "0.1"]) == 0
    assert "sent 12 instants" in terminal.getvalue()


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (
            ["--as", "joints_udp"],
            "nothing to send: give a RECORDING, or --source NAME, e.g. --source performer\n",
        ),
        (
            ["x.bvh", "--as", "joint_udp"],
            "--as joint_udp: 'joint_udp' is no protocol; did you mean 'joints_udp'?\n",
        ),
        (
            ["no.bvh", "--as", "joints_udp"],
            "no.bvh: there is no such file\n1 problem found; nothing was run\n",
        ),
        (
            [*STAND, "--set", "rate_hz=3"],
            "--set rate_hz=3: there is only a source here; write source.option=value\n"
            "1 problem found; nothing was run\n",
        ),
        (
            [*STAND, "--set", "source.scenaro=walk"],
            "--set source.scenaro=walk: source.scenaro: 'performer' has no such option; did you mean 'scenario'?\n"
            "1 problem found; nothing was run\n",
        ),
        (
            ["--source", "joints_udp", "--as", "joints_udp"],
            "--source joints_udp: it listens to a network itself; give a recording\n",
        ),
        (
            [*STAND, "--to", "127.0.0.1:99999"],
            "--to 127.0.0.1:99999: '99999' is no port; write HOST:PORT with a port from 1 to 65535\n",
        ),
        (
            [*STAND, "--to", "no.such.machine.invalid:9000"],
            "--to no.such.machine.invalid:9000: no machine is known as 'no.such.machine.invalid'; "
            "write HOST:PORT, e.g. 127.0.0.1:9000\n",
        ),
        (
            [*STAND, "--prepare", "--loop"],
            "--prepare with --loop never begins: say how much to prepare with --seconds S\n",
        ),
        (
            [*STAND, "--loss", "101"],
            "imitor stream: argument --loss: should be from 0 to 100 per cent, got '101'\n"
            "help: imitor stream --help\n",
        ),
        (
            [*STAND, "--speed", "0"],
            "imitor stream: argument --speed: should be above 0, got '0'\nhelp: imitor stream --help\n",
        ),
        (
            [*STAND, "--jitter", "nan"],
            "imitor stream: argument --jitter: should be a number, got 'nan'\nhelp: imitor stream --help\n",
        ),
    ],
)
def test_wrong_arguments(argv: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, *argv) == (2, said)


def test_a_source_that_does_not_listen_is_no_protocol(capsys: pytest.CaptureFixture[str]) -> None:
    status, err = call(capsys, "--source", "performer", "--as", "bvh")
    assert status == 2
    assert err.startswith("--as bvh: 'bvh' reads no network; known: ") and "joints_udp" in err


def test_interruption_says_what_was_sent() -> None:
    command = heeds_interrupts("stream", *STAND, "--to", "127.0.0.1:9", "--loop")
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as child:
        assert child.stderr is not None
        first = child.stderr.readline()
        child.send_signal(signal.SIGINT)
        rest = child.stderr.read()
        assert child.wait(20) == 130
    assert first.startswith("sending 6.0 s over and over at 120 Hz as joints_udp to 127.0.0.1:9")
    assert rest.startswith("interrupted: sent ") and "Traceback" not in rest
