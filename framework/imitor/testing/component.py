"""The one call that an author needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from imitor.kinds import kind_of
from imitor.testing.expect import AnyComponent
from imitor.testing.filters import check_filter
from imitor.testing.imports import check_import
from imitor.testing.mappers import check_mapper
from imitor.testing.options import check_config, check_names
from imitor.testing.postprocessors import check_postprocessor
from imitor.testing.sinks import check_sink
from imitor.testing.solvers import check_solver
from imitor.testing.sources import check_source
from imitor.testing.stabilizers import check_stabilizer

_CHECKS: Final[Mapping[str, Any]] = {
    "source": check_source,
    "filter": check_filter,
    "mapper": check_mapper,
    "stabilizer": check_stabilizer,
    "solver": check_solver,
    "postprocessor": check_postprocessor,
    "sink": check_sink,
}


def check_component(cls: AnyComponent, config: Mapping[str, Any] | None = None) -> None:
    """Run every check that applies to a plugin's kind.

    Args:
        cls: The plugin's class.
        config: Its options as in YAML; needed when some have no default. A solver's ``order`` is chosen by the kit.

    Raises:
        AssertionError: A rule is broken; says which, by which plugin, and what was seen.
    """
    check_names(cls)
    check_config(cls, config)
    check_import(cls)
    _CHECKS[kind_of(cls)](cls, config)
