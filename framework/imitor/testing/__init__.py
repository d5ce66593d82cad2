"""The conformance kit: what every plugin must keep, checked by one call in its author's tests.

    from imitor.testing import check_component

    def test_keeps_the_contract_of_its_kind() -> None:
        check_component(MyFilter)

A broken rule is an ``AssertionError`` that names the plugin, the rule and what was seen. The checks need no files and
no network; heavy packages are imported when a check runs.
"""

from imitor.testing.component import check_component
from imitor.testing.filters import check_filter
from imitor.testing.fixtures import Run, make_context, make_frames, make_robot, make_run, make_skeleton
from imitor.testing.imports import HEAVY_PACKAGES, check_import
from imitor.testing.live import check_live_source
from imitor.testing.mappers import check_mapper
from imitor.testing.options import check_config, check_names
from imitor.testing.postprocessors import check_postprocessor
from imitor.testing.sinks import check_sink
from imitor.testing.solvers import check_solver
from imitor.testing.sources import check_frames, check_source
from imitor.testing.stabilizers import check_stabilizer

__all__ = [
    "HEAVY_PACKAGES",
    "Run",
    "check_component",
    "check_config",
    "check_filter",
    "check_frames",
    "check_import",
    "check_live_source",
    "check_mapper",
    "check_names",
    "check_postprocessor",
    "check_sink",
    "check_solver",
    "check_source",
    "check_stabilizer",
    "make_context",
    "make_frames",
    "make_robot",
    "make_run",
    "make_skeleton",
]
