"""Move the G1 of a DDS domain with the sink ``unitree``, in a process of its own: ``python unitree_client.py OPTIONS``.

Prints the sink's figures or its error in JSON.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path

from imitor.errors import ImitorError
from imitor.plugins.robots.unitree import Unitree
from imitor.testing import make_robot
from sink_peers import opened, records, run_of


def main() -> None:
    os.environ.pop("CYCLONEDDS_URI", None)
    options = json.loads(sys.argv[1])
    n = options.pop("n", 25)
    robot = make_robot()
    run = run_of(Path(tempfile.mkdtemp()), robot)
    try:
        sink = opened(Unitree, run, armed=True, **options)
        for record in records(run, [robot.standing] * n):
            sink.write(record)
            time.sleep(0.02)
        out = sink.finish().figures
        sink.close()
        sink.close()
    except ImitorError as error:
        out = {"error": str(error)}
    print(json.dumps(out), flush=True)
    os._exit(0)


if __name__ == "__main__":
    main()
