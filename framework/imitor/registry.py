"""Which plugins there are. pluggy registers classes once, at start; it never sees a frame.

A registry is an object, not a global: tests make their own. A plugin that fails to import is remembered and the
rest go on; it is reported where it is needed and by ``imitor list``.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import pkgutil
import traceback
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pluggy

from imitor.errors import DuplicateComponent, PluginError, PluginLoadError, did_you_mean, told
from imitor.hooks import PROJECT, HookSpecs
from imitor.kinds import KINDS, Component, kind_of

BUILTIN = "imitor.plugins"
ENTRY_POINTS = "imitor"


@dataclass(frozen=True)
class Failure:
    """A plugin that could not be loaded."""

    plugin: str
    module: str
    error: str
    trace: str


@dataclass(frozen=True)
class Registered:
    """A component class and where it comes from."""

    component: type[Component[Any]]
    kind: str
    name: str
    origin: str


class Registry:
    """The components and data cards of imitor and of installed plugins.

    Args:
        entry_points: Whether to load third-party plugins. The environment variable ``IMITOR_PLUGINS`` (names
            separated by commas, empty for none) limits them.
        without: Plugin names or module names to leave out.
    """

    def __init__(self, *, entry_points: bool = True, without: Iterable[str] = ()) -> None:
        self._manager = pluggy.PluginManager(PROJECT)
        self._manager.add_hookspecs(HookSpecs)
        self._without = set(without)
        self._components: dict[tuple[str, str], Registered] = {}
        self.failures: list[Failure] = []
        self._plugins: list[tuple[str, str]] = []
        for module in _builtin_modules():
            self._load(module.rsplit(".", 1)[1], module)
        if entry_points:
            self._load_entry_points()
        for plugin_name, plugin in self._manager.list_name_plugin():
            if isinstance(plugin, ModuleType):
                self._collect(plugin_name, plugin)

    def _load(self, name: str, module: str) -> None:
        if {name, module} & self._without:
            return
        try:
            plugin = importlib.import_module(module)
            self._manager.register(plugin, module)
            self._refuse_unknown_hooks(plugin)
        except Exception as error:  # whatever a plugin's import raises must not stop the others
            self._fail(name, module, error)
        else:
            self._plugins.append((name, module))

    def _refuse_unknown_hooks(self, plugin: object) -> None:
        """Refuse a misspelt hook, which would silently never be called."""
        try:
            self._manager.check_pending()
        except pluggy.PluginValidationError as error:
            self._manager.unregister(plugin)
            known = [name for name in vars(HookSpecs) if name.startswith(PROJECT)]
            marked = [name for name in dir(plugin) if hasattr(getattr(plugin, name), f"{PROJECT}_impl")]
            wrong = next((name for name in marked if name not in known), "")
            hint = did_you_mean(wrong, known)
            raise PluginError(
                getattr(plugin, "__name__", ""),
                f"unknown hook '{wrong}'" + (f"; {hint}" if hint else f"; hooks: {', '.join(known)}"),
            ) from error

    def _load_entry_points(self) -> None:
        wanted = os.environ.get("IMITOR_PLUGINS")
        allowed = None if wanted is None else {w.strip() for w in wanted.split(",")}
        for point in sorted(importlib.metadata.entry_points(group=ENTRY_POINTS), key=lambda p: p.name):
            if allowed is None or point.name in allowed:
                self._load(point.name, point.value)

    def _fail(self, name: str, module: str, error: BaseException) -> None:
        text = str(error) if isinstance(error, ImportError | PluginError) else told(error)
        self.failures.append(Failure(name, module, text, traceback.format_exc()))

    def _collect(self, module: str, plugin: ModuleType) -> None:
        hook = getattr(plugin, "imitor_components", None)
        if hook is None:
            return
        try:
            for component in hook():
                self.add(component, module)
        except DuplicateComponent:
            raise
        except Exception as error:
            self._fail(module, module, error)

    def register(self, plugin: object, name: str) -> None:
        """Register a plugin object (a module or namespace with hook implementations) by hand, for tests."""
        self._manager.register(plugin, name)
        for component in getattr(plugin, "imitor_components", list)():
            self.add(component, name)

    def add(self, component: type[Component[Any]], origin: str) -> None:
        """Add one component class.

        Raises:
            DuplicateComponent: The name is taken in that kind.
            PluginError: The class has no name.
        """
        kind = kind_of(component)
        if not component.name:
            raise PluginError(
                origin, f"{component.__module__}.{component.__qualname__} has no `name`; give it one"
            )
        key = (kind, component.name)
        other = self._components.get(key)
        if other is not None:
            raise DuplicateComponent(
                origin,
                f"{kind} '{component.name}' is registered twice: {other.origin} and {origin}. "
                f"Block one: --without {origin}.",
            )
        self._components[key] = Registered(component, kind, component.name, origin)

    def names(self, kind: str) -> list[str]:
        """Return the sorted names of a kind's components."""
        return sorted(n for k, n in self._components if k == kind)

    def find(self, kind: str, name: str) -> Registered | None:
        """Return a component, or ``None``."""
        return self._components.get((kind, name))

    def get(self, kind: str, name: str) -> type[Component[Any]]:
        """Return a component class.

        Raises:
            PluginLoadError: No such component, because its plugin failed to load or does not exist.
        """
        found = self._components.get((kind, name))
        if found is not None:
            return found.component
        for failure in self.failures:
            if name in (failure.plugin, failure.module.rsplit(".", 1)[-1]):
                raise PluginLoadError(
                    failure.plugin,
                    f"plugin '{failure.plugin}' ({failure.module}) failed to load: {failure.error}",
                )
        hint = did_you_mean(name, self.names(kind))
        raise PluginLoadError(
            name, f"no {kind} is called '{name}'" + (f"; {hint}" if hint else "") + f" (imitor list {kind})"
        )

    def __iter__(self) -> Iterator[Registered]:
        order = list(KINDS)
        return iter(sorted(self._components.values(), key=lambda r: (order.index(r.kind), r.name)))

    @property
    def plugins(self) -> list[tuple[str, str]]:
        """Loaded plugins as (name, module)."""
        return list(self._plugins)

    def cards(self, folder: str) -> dict[str, Path]:
        """Return the data cards of a folder (``robots``, ``skeletons``, ``markersets``, ``pipelines``) by name."""
        found: dict[str, Path] = {}
        for root in self._card_roots(folder):
            if root.is_dir():
                for path in sorted(root.glob("*.yaml")):
                    found.setdefault(path.stem, path)
        return found

    def _card_roots(self, folder: str) -> Iterator[Path]:
        here = Path(__file__).parent
        yield {
            "robots": here / "plugins" / "robots" / "cards",
            "skeletons": here / "plugins" / "sources" / "skeletons",
            "markersets": here / "plugins" / "sources" / "markersets",
            "pipelines": here / "pipelines",
        }[folder]
        for roots in self._call("imitor_cards"):
            for root in roots:
                yield Path(root) / folder

    def announce(self, event: str, facts: Mapping[str, Any]) -> None:
        """Tell every plugin that observes runs what happened."""
        self._call("imitor_run_event", event=event, facts=facts)

    def _call(self, hook: str, **arguments: Any) -> list[Any]:
        """Call a hook of every plugin; one that raises is remembered as a failure and not called again."""
        results = []
        for implementation in reversed(getattr(self._manager.hook, hook).get_hookimpls()):
            plugin = implementation.plugin
            try:
                wanted = [arguments[name] for name in implementation.argnames]
                results.append(implementation.function(*wanted))
            except Exception as error:  # an observer must not end a run
                self._fail(implementation.plugin_name, getattr(plugin, "__name__", ""), error)
                self._manager.unregister(plugin)
        return results


def _builtin_modules() -> list[str]:
    package = importlib.import_module(BUILTIN)
    names = [m.name for m in pkgutil.walk_packages(package.__path__, f"{BUILTIN}.") if not m.ispkg]
    return sorted(n for n in names if not n.rsplit(".", 1)[1].startswith("_"))
