"""Play a recording on the network in real time, as a capture system would send it.

RECORDING is a motion file, read by the source that knows it; or give --source NAME instead.
PROTOCOL is a live source (imitor list source), which also says how its datagrams are made.
Example: imitor stream walk.c3d --as marker_udp --loop --loss 2
         imitor stream --source performer --set source.markers=41 --as marker_udp
"""

from __future__ import annotations

import argparse
import contextlib
import ipaddress
import math
import socket
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

from imitor.cli import common
from imitor.errors import ImitorError, did_you_mean
from imitor.kinds import Source
from imitor.live.source import LiveSource
from imitor.live.stream import Departure, Network, Sent, departures, instants, send
from imitor.registry import Registry
from imitor.spec import load_source

HOST: Final = "127.0.0.1"
_REDRAW_S: Final = 0.2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("recording", metavar="RECORDING", nargs="?", type=Path, help="a motion file")
    parser.add_argument("--as", metavar="PROTOCOL", dest="protocol", required=True, help="a live source")
    parser.add_argument(
        "--to",
        metavar="HOST:PORT",
        default=HOST,
        help=f"where to send; default {HOST} and the protocol's port",
    )
    parser.add_argument("--source", metavar="NAME", help="the source to use, also for RECORDING")
    parser.add_argument(
        "--set",
        metavar="source.option=value",
        action="append",
        default=[],
        dest="sets",
        help="change an option",
    )
    parser.add_argument("--speed", metavar="X", type=_above_zero, default=1.0, help="playback speed [-]")
    parser.add_argument("--rate", metavar="HZ", type=_above_zero, help="instants a second [Hz]")
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument("--seconds", metavar="S", type=_above_zero, default=math.inf, help="stop after S [s]")
    parser.add_argument(
        "--loss", metavar="PERCENT", type=_share, default=0.0, help="datagrams that are lost [%%]"
    )
    parser.add_argument("--jitter", metavar="MS", type=_not_negative, default=0.0, help="greatest delay [ms]")
    parser.add_argument(
        "--reorder",
        metavar="PERCENT",
        type=_share,
        default=0.0,
        help="datagrams that later ones overtake [%%]",
    )
    parser.add_argument(
        "--duplicate", metavar="PERCENT", type=_share, default=0.0, help="datagrams that come twice [%%]"
    )
    parser.add_argument("--seed", metavar="N", type=_whole, default=0, help="seed of the losses [-]")
    parser.add_argument(
        "--prepare",
        action="store_true",
        help="make all datagrams before the first one leaves: sending then takes hardly any of this machine's time, as "
        "if another one sent (with --loop: give --seconds)",
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but problems")
    common.add_without(parser)


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"should be a number, got '{text}'")
    return value


def _above_zero(text: str) -> float:
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"should be above 0, got '{text}'")
    return value


def _not_negative(text: str) -> float:
    value = _number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"should be 0 or more, got '{text}'")
    return value


def _share(text: str) -> float:
    value = _number(text)
    if not 0 <= value <= 100:
        raise argparse.ArgumentTypeError(f"should be from 0 to 100 per cent, got '{text}'")
    return value / 100


def _whole(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"should be a whole number from 0, got '{text}'")
    return int(text)


def execute(args: argparse.Namespace) -> int:
    """Carry the command out."""
    if args.prepare and args.loop and math.isinf(args.seconds):
        raise ImitorError("--prepare with --loop never begins: say how much to prepare with --seconds S")
    registry = common.make_registry(args.without)
    protocol = _protocol(args.protocol, registry)
    family, address = _address(args.to, protocol.config_type.model_fields["port"].default)
    source = _source(args, registry)
    sent, interrupted = Sent(), False
    where = f"as {protocol.name} to {_shown(address)}"
    say: Callable[[str], None] = (
        (lambda _: None) if args.quiet else (lambda text: print(text, file=sys.stderr))
    )
    source.start()
    try:
        encoder = protocol.encoder(source)
        hz = args.rate or source.rate_hz * args.speed
        say(f"sending {_length(source, args)} at {hz:g} Hz {where}{_beyond(address[0])}; Ctrl-C ends it")
        told = instants(
            source, encoder, speed=args.speed, rate_hz=args.rate, loop=args.loop, seconds=args.seconds
        )
        network = Network(args.loss, args.jitter / 1000, args.reorder, args.duplicate, args.seed)
        with _Status(sent, quiet=args.quiet) as status, socket.socket(family, socket.SOCK_DGRAM) as sock:
            with contextlib.suppress(OSError):  # an address that is no broadcast address does not need it
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            leaving: Iterable[Departure] = departures(told, network, 1.0 / hz, sent)
            if args.prepare:
                say("preparing all datagrams ...")
                leaving = list(leaving)
            send(leaving, sock, address, sent, watch=status)
    except KeyboardInterrupt:
        interrupted = True
    finally:
        source.close()
    say(
        ("interrupted: " if interrupted else "")
        + _summary(sent, where, "prepared" if args.prepare else "sent")
    )
    return 130 if interrupted else 0


def _protocol(name: str, registry: Registry) -> type[LiveSource[Any]]:
    live = {r.name: r.component for r in registry if issubclass(r.component, LiveSource)}
    if name not in live:
        known = f"known: {', '.join(live)}" if live else "none is installed here"
        what = "reads no network" if registry.find("source", name) else "is no protocol"
        raise ImitorError(f"--as {name}: '{name}' {what}; {did_you_mean(name, live) or known}")
    return live[name]


def _source(args: argparse.Namespace, registry: Registry) -> Source[Any]:
    if args.recording is None and args.source is None:
        raise ImitorError("nothing to send: give a RECORDING, or --source NAME, e.g. --source performer")
    spec = load_source(registry, input=args.recording, source=args.source, sets=args.sets)
    component = registry.get("source", spec.name)
    if not issubclass(component, Source) or component.live:
        raise ImitorError(f"--source {spec.name}: it listens to a network itself; give a recording")
    return component(spec.config)


def _address(text: str, port: int) -> tuple[socket.AddressFamily, tuple[Any, ...]]:
    """Return family and address of ``HOST``, ``HOST:PORT`` or ``[HOST]:PORT``."""
    host, colon, number = text.rpartition(":")
    if not colon or (":" in host and not host.endswith("]")):
        host, number = text, str(port)
    if not (number.isdecimal() and 0 < int(number) < 65536):
        raise ImitorError(f"--to {text}: '{number}' is no port; write HOST:PORT with a port from 1 to 65535")
    try:
        found = socket.getaddrinfo(host.strip("[]") or HOST, int(number), type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError):
        raise ImitorError(
            f"--to {text}: no machine is known as '{host}'; write HOST:PORT, e.g. {HOST}:9000"
        ) from None
    family, _, _, _, address = min(found, key=lambda f: f[0] != socket.AF_INET)
    return family, address


def _shown(address: tuple[Any, ...]) -> str:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _beyond(host: str) -> str:
    return "" if ipaddress.ip_address(host.partition("%")[0]).is_loopback else ", beyond this machine"


def _length(source: Source[Any], args: argparse.Namespace) -> str:
    if source.n_frames is None:
        return "frames"
    seconds = source.n_frames / (source.rate_hz * args.speed)
    return f"{seconds:.1f} s" + (" over and over" if args.loop else "")


def _summary(sent: Sent, where: str, done: str) -> str:
    text = f"{done} {sent.instants} instants {where}: {sent.datagrams} datagrams, {sent.bytes / 1000:.0f} kB"
    chance = (("lost", sent.lost), ("reordered", sent.reordered), ("duplicated", sent.duplicated))
    parts = [f"{count} {name}" for name, count in chance if count]
    return (
        text + (f" ({', '.join(parts)})" if parts else "") + f"; at most {1000 * sent.latest_s:.1f} ms late"
    )


class _Status:
    """A line on a terminal that says how far the playing is; nothing elsewhere."""

    def __init__(self, sent: Sent, *, quiet: bool) -> None:
        self._sent, self._stream = sent, sys.stderr
        self._shown = not quiet and self._stream.isatty()
        self._next_s = 0.0

    def __call__(self, time_s: float) -> None:
        if not self._shown or time_s < self._next_s:
            return
        self._next_s = time_s + _REDRAW_S
        s = self._sent
        self._write(f"\r{time_s:8.1f} s  {s.instants} instants  {s.datagrams} datagrams\x1b[K")

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # trouble with the terminal never stops the playing
            self._shown = False

    def __enter__(self) -> _Status:
        return self

    def __exit__(self, *exc: object) -> None:
        if self._shown and self._next_s:
            self._write("\r\x1b[K")
