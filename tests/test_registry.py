"""The registry: every plugin of ours, those that are installed, those that fail, those that clash."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from imitor import Component, Config, Filter, HumanFrame, hookimpl
from imitor.errors import DuplicateComponent, ImitorError, PluginError, PluginLoadError
from imitor.kinds import KINDS, kind_of
from imitor.registry import Registry

PLUGIN = '''
from imitor import Config, Filter, hookimpl

class {cls}(Filter[Config]):
    """Keep."""
    name = "{name}"

    def step(self, frame):
        return frame

@hookimpl
def imitor_components():
    return [{cls}]
'''


class Keep(Filter[Config]):
    """Give the frame back."""

    name = "keep"

    def step(self, frame: HumanFrame) -> HumanFrame:
        return frame


def distribution(folder: Path, modules: dict[str, str], points: dict[str, str]) -> Path:
    """Write an installed distribution with modules and entry points; return its folder, for sys.path."""
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text)
    info = folder / "acme_imitor-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-imitor\nVersion: 1.0\n")
    lines = ["[imitor]", *(f"{name} = {value}" for name, value in points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


def ask(code: str, *folders: Path, **environment: str) -> str:
    """Run code in a fresh interpreter with folders on its path; return what it prints."""
    import os

    path = os.pathsep.join(map(str, folders))
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": path, **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


SHOW = "from imitor.registry import Registry; print(Registry(without=['{}']).get('filter', 'human_com'))"
NAMES = "from imitor.registry import Registry; r = Registry(); print(r.names('filter'), [f.plugin for f in r.failures])"


@pytest.fixture
def acme(tmp_path: Path) -> Path:
    """Three plugins: one good, one that cannot be imported, one whose hook raises."""
    modules = {
        "acme_good": PLUGIN.format(cls="Good", name="acme_good"),
        "acme_bad": "import acme_sdk\n",
        "acme_ugly": "from imitor import hookimpl\n@hookimpl\ndef imitor_components():\n    return 1 / 0\n",
    }
    return distribution(tmp_path, modules, {name: name for name in modules})


def test_every_kind_of_ours_is_found_without_a_list() -> None:
    registry = Registry(entry_points=False)
    assert registry.failures == []
    assert registry.names("solver") == sorted(registry.names("solver"))
    root = Path(__file__).parents[1] / "plugins"
    for kind, folder in (
        ("source", "sources"),
        ("filter", "filters"),
        ("mapper", "mappers"),
        ("solver", "solvers"),
    ):
        modules = [p.stem for p in (root / folder).glob("[!_]*.py")]
        origins = {r.origin.rsplit(".", 1)[1] for r in registry if r.kind == kind}
        assert origins == set(modules)


def test_components_come_in_the_order_of_kinds_and_names() -> None:
    listed = [(r.kind, r.name) for r in Registry(entry_points=False)]
    assert listed == sorted(listed, key=lambda item: (list(KINDS).index(item[0]), item[1]))
    assert len(listed) == len(set(listed))


def test_installed_plugins_are_found_by_their_entry_point(acme: Path) -> None:
    assert "acme_good" in ask(NAMES, acme)


def test_a_plugin_that_fails_is_reported_and_the_rest_go_on(acme: Path) -> None:
    code = (
        "from imitor.registry import Registry\n"
        "r = Registry()\n"
        "assert 'acme_good' in r.names('filter') and 'human_com' in r.names('filter')\n"
        "for f in r.failures: print(f.plugin.rsplit('.')[-1], '|', f.module, '|', f.error)\n"
        "assert 'Traceback' in r.failures[0].trace\n"
        "from imitor.errors import PluginLoadError\n"
        "try:\n    r.get('source', 'acme_bad')\nexcept PluginLoadError as e:\n    print(e, e.plugin, e.exit_status)\n"
    )
    lines = ask(code, acme).splitlines()
    assert lines == [
        "acme_bad | acme_bad | No module named 'acme_sdk'",
        "acme_ugly | acme_ugly | ZeroDivisionError: division by zero",
        "plugin 'acme_bad' (acme_bad) failed to load: No module named 'acme_sdk' acme_bad 2",
    ]


def test_the_list_command_goes_on_too(acme: Path) -> None:
    text = ask("from imitor.cli import main; raise SystemExit(main(['list']))", acme)
    assert "acme_good" in text
    assert "No module named 'acme_sdk'" in text


@pytest.mark.parametrize(
    ("allowed", "found", "failed"),
    [
        ("acme_good", True, []),
        ("", False, []),
        ("acme_bad, acme_good", True, ["acme_bad"]),
        ("other", False, []),
    ],
)
def test_the_environment_limits_installed_plugins(
    acme: Path, allowed: str, found: bool, failed: list[str]
) -> None:
    text = ask(NAMES, acme, IMITOR_PLUGINS=allowed)
    assert ("acme_good" in text) is found
    assert text.endswith(str(failed))


def test_entry_points_can_be_left_out(acme: Path) -> None:
    assert "acme_good" not in ask(NAMES.replace("Registry()", "Registry(entry_points=False)"), acme)


def test_two_with_one_name_are_refused_and_one_can_be_blocked(tmp_path: Path) -> None:
    text = PLUGIN.format(cls="Mine", name="human_com")
    folder = distribution(tmp_path, {"acme_com": text}, {"acme": "acme_com"})
    code = (
        "from imitor.registry import Registry\nfrom imitor.errors import DuplicateComponent\n"
        "try:\n    Registry()\nexcept DuplicateComponent as e:\n    print(e, e.plugin)\n"
    )
    assert ask(code, folder) == (
        "filter 'human_com' is registered twice: imitor.plugins.filters.human_com and acme_com. "
        "Block one: --without acme_com. acme_com"
    )
    command = "from imitor.cli import main; raise SystemExit(main(['show', 'human_com'{}]))"
    for blocked in ("acme", "acme_com"):
        code = SHOW.format(blocked)
        assert "imitor.plugins.filters.human_com" in ask(code, folder)
    assert "acme_com" in ask(SHOW.format("human_com"), folder)
    assert "acme_com" in ask(command.format(", '--without', 'human_com'"), folder)


def test_a_plugin_of_ours_can_be_left_out() -> None:
    for name in ("human_com", "imitor.plugins.filters.human_com"):
        registry = Registry(entry_points=False, without=[name])
        assert "human_com" not in registry.names("filter")
        assert registry.find("filter", "human_com") is None
        with pytest.raises(PluginLoadError, match="no filter is called 'human_com'"):
            registry.get("filter", "human_com")


def test_an_unknown_name_has_a_suggestion() -> None:
    with pytest.raises(PluginLoadError) as caught:
        Registry(entry_points=False).get("filter", "humancom")
    assert (
        str(caught.value) == "no filter is called 'humancom'; did you mean 'human_com'? (imitor list filter)"
    )


def test_a_component_added_by_hand() -> None:
    registry = Registry(entry_points=False)
    registry.add(Keep, "here")
    assert registry.get("filter", "keep") is Keep
    with pytest.raises(
        DuplicateComponent, match=r"registered twice: here and there. Block one: --without there"
    ):
        registry.add(Keep, "there")


def test_a_component_without_a_name_is_refused() -> None:
    nameless = type("Nameless", (Keep,), {"name": ""})
    with pytest.raises(PluginError, match="Nameless has no `name`; give it one"):
        Registry(entry_points=False).add(nameless, "here")


def test_a_class_of_no_kind_is_refused() -> None:
    class Odd(Component[Config]):
        """Nothing."""

        name = "odd"

    with pytest.raises(ImitorError, match="derives from none of source, filter"):
        kind_of(Odd)
    with pytest.raises(ImitorError, match="derives from none of"):
        Registry(entry_points=False).add(Odd, "here")


def test_options_class_comes_from_the_generic_argument() -> None:
    class MineConfig(Config):
        """Options."""

    class Mine(Filter[MineConfig]):
        """Keep."""

    class Derived(Mine):
        """Keep."""

    assert Mine.config_type is MineConfig
    assert Derived.config_type is MineConfig
    assert Mine.kind == "filter"


def test_options_named_in_the_class_count() -> None:
    class Other(Config):
        """Options."""

    class Derived(Keep):
        """Keep."""

        config_type = Other

    assert Derived.config_type is Other


def test_cards_of_a_plugin_are_found_and_ours_come_first(tmp_path: Path) -> None:
    robots = tmp_path / "robots"
    robots.mkdir()
    for name in ("acme_robot", "romeo"):
        (robots / f"{name}.yaml").write_text("x: 1")

    class Plugin:
        @hookimpl
        def imitor_cards(self) -> list[Path]:
            return [tmp_path]

    registry = Registry(entry_points=False)
    registry.register(Plugin(), "acme")
    cards = registry.cards("robots")
    assert cards["acme_robot"] == robots / "acme_robot.yaml"
    assert cards["romeo"].parent != robots
    assert registry.cards("markersets").keys() >= set()


def test_runs_are_announced() -> None:
    heard: list[Any] = []

    class Plugin:
        @hookimpl
        def imitor_run_event(self, event: str, facts: Any) -> None:
            heard.append((event, dict(facts)))

    registry = Registry(entry_points=False)
    registry.register(Plugin(), "listener")
    registry.announce("started", {"pipeline": "demo"})
    assert heard == [("started", {"pipeline": "demo"})]


def test_hooks_that_raise_do_not_disturb_the_others() -> None:
    heard: list[str] = []

    class Ugly:
        @hookimpl
        def imitor_cards(self) -> list[Path]:
            raise OSError("no such share")

        @hookimpl
        def imitor_run_event(self, event: str) -> None:
            raise ValueError("no server")

    class Listener:
        @hookimpl
        def imitor_run_event(self, event: str) -> None:
            heard.append(event)

    registry = Registry(entry_points=False)
    registry.register(Listener(), "listener")
    registry.register(Ugly(), "ugly")
    registry.announce("built", {})
    registry.announce("started", {})
    assert heard == ["built", "started"]
    assert [(f.plugin, f.error) for f in registry.failures] == [("ugly", "ValueError: no server")]
    registry.register(Ugly(), "worse")
    assert "romeo" in registry.cards("robots")
    assert [(f.plugin, f.error) for f in registry.failures[1:]] == [("worse", "OSError: no such share")]


def test_a_registered_namespace_needs_no_hooks() -> None:
    registry = Registry(entry_points=False)
    before = len(list(registry))
    registry.register(SimpleNamespace(), "empty")
    assert len(list(registry)) == before


def test_the_registry_imports_nothing_heavy() -> None:
    heavy = ("pinocchio", "placo", "mujoco", "fcl", "rerun", "scipy", "trimesh", "PIL", "rich")
    code = "import sys\nfrom imitor.registry import Registry\nRegistry()\n"
    assert ask(f"{code}print([h for h in {heavy} if h in sys.modules])") == "[]"
