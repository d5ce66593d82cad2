"""Move the NAO at a port with the sink ``naoqi``, in a process of its own: ``python naoqi_client.py PORT OPTIONS``.

Prints the sink's figures or its error as the last line, in JSON.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path

from imitor.errors import ImitorError
from imitor.plugins.robots.naoqi import Naoqi
from imitor.testing import make_robot
from sink_peers import opened, records, run_of


def main() -> None:
    options = json.loads(sys.argv[2])
    rate, n = options.pop("rate_hz", 50.0), options.pop("n", 20)
    robot = make_robot("nao_v4")
    run = run_of(Path(tempfile.mkdtemp()), robot, rate_hz=rate)
    try:
        sink = opened(Naoqi, run, armed=True, port=int(sys.argv[1]), **options)
        for record in records(run, [robot.standing] * n):
            sink.write(record)
            time.sleep(1.0 / rate)
        out = sink.finish().figures
        sink.close()
        sink.close()
    except ImitorError as error:
        out = {"error": str(error)}
    print(json.dumps(out), flush=True)
    os._exit(0)  # qi's threads do not always end


if __name__ == "__main__":
    main()
