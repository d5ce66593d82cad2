"""The hooks of imitor's plugin system. Called at start and at the ends of a run, never per frame."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pluggy

if TYPE_CHECKING:
    from imitor.kinds import Component

PROJECT: Final = "imitor"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


class HookSpecs:
    """Every hook that a plugin can implement."""

    @hookspec
    def imitor_components(self) -> list[type[Component[Any]]]:  # type: ignore[empty-body]
        """Return the component classes of this plugin; called once, when the registry is made."""

    @hookspec
    def imitor_cards(self) -> list[Path]:  # type: ignore[empty-body]
        """Return folders with this plugin's data: ``robots/``, ``skeletons/``, ``markersets/``, ``pipelines/``."""

    @hookspec
    def imitor_run_event(self, event: str, facts: Mapping[str, Any]) -> None:
        """Observe a run: ``event`` is built, started, finished or failed; ``facts`` say which run and where."""
