"""What a live source costs an instant: from its datagrams to a human frame, without the network.

    python benchmarks/live_decoding.py [SOURCE ...] [--option NAME=VALUE ...]

The performer, with markers and targets, is sent by each source's own encoder and received again, in 20 rounds; time is
that of the processor.

Columns: bytes and datagrams an instant; decoding, and decoding with the human frame, best and median [ms].
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import imitor  # noqa: F401  (sets one BLAS thread before numpy is imported)
from imitor.errors import ImitorError
from imitor.live.source import LiveSource
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.registry import Registry

ROUNDS = 20


def main() -> None:
    """Measure and print a line a source."""
    live = {r.name: r.component for r in Registry() if issubclass(r.component, LiveSource)}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sources", nargs="*", metavar="SOURCE", help=", ".join(live))
    parser.add_argument("--option", action="append", default=[], metavar="NAME=VALUE")
    args = parser.parse_args()
    options = dict(text.split("=", 1) for text in args.option)
    sent = Performer(PerformerConfig(scenario="walk", rate_hz=60.0, markers="41", targets=True))
    sent.start()
    print(f"{'source':14s} {'bytes':>7s} {'datagrams':>9s} {'decode':>8s} {'frame':>8s} {'median':>8s}")
    for name in args.sources or live:
        source = live[name](live[name].config_type.model_validate(options))
        try:
            encoder = source.encoder(sent)
        except ImitorError as error:
            print(f"{name:14s} {error}")
            continue
        packets = [d for i, f in enumerate(sent.frames()) for d in encoder.encode(f, i)]
        source.rate_hz = sent.rate_hz
        source.learn([s for s in map(source.decoder().decode, packets) if s is not None][:60])
        decode, whole = [], []
        for _ in range(ROUNDS):
            decoder = source.decoder()
            begin = time.process_time()
            samples = [s for s in map(decoder.decode, packets) if s is not None]
            decoded = time.process_time()
            for i, sample in enumerate(samples):
                source.human(sample, i / sent.rate_hz)
            decode.append((decoded - begin) / len(samples))
            whole.append((time.process_time() - begin) / len(samples))
        size, count = sum(map(len, packets)) / len(samples), len(packets) / len(samples)
        figures = [1000 * v for v in (min(decode), min(whole), float(np.median(whole)))]
        print(f"{name:14s} {size:7.0f} {count:9.2f} " + " ".join(f"{v:8.3f}" for v in figures))


if __name__ == "__main__":
    main()
