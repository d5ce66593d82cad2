"""The documentation tells the truth: commands run, pages are in step with the code, keys and links lead somewhere."""

from __future__ import annotations

import importlib
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from imitor.cli import main
from small_bvh import small_bvh
from small_humanoid import SmallHumanoid

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [
    *(p for p in sorted(DOCS.rglob("*.md")) if "_build" not in p.parts),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
]
FRAMES = "3"


def blocks(page: Path) -> Iterator[tuple[str, str]]:
    """Yield language and text of every fenced block."""
    for fence in re.finditer(r"^```(\w+)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S):
        yield fence[1], fence[2]


def install(folder: Path) -> None:
    """Make a plugin's package known as ``pip install -e`` does, for this folder only."""
    project = (folder / "pyproject.toml").read_text()
    name = re.search(r'^name = "(.*)"', project, re.M)
    points = re.search(r"^\[project.entry-points.imitor\]\n((?:.+\n)+)", project, re.M)
    assert name
    assert points
    info = folder / f"{name[1].replace('-', '_')}-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name[1]}\nVersion: 0.1.0\n")
    (info / "entry_points.txt").write_text("[imitor]\n" + points[1].replace('"', ""))


@pytest.mark.parametrize("page", ["README.md", "docs/tutorial.md"])
def test_what_a_page_says_works(
    page: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    """Write its files, carry out its commands, in the order of the page."""
    monkeypatch.chdir(tmp_path)
    Path("walk.bvh").write_text(small_bvh())
    Path("small.urdf").write_text(SmallHumanoid().urdf())
    done = 0
    request.addfinalizer(stop_senders)
    for language, text in blocks(ROOT / page):
        if language in ("yaml", "python"):
            head = re.match(r"# (\S+)\n", text)
            assert head, f"the first line of a {language} block names its file"
            path = Path(head[1])
            if path.parent.name and not path.parent.is_dir():  # `imitor new` makes it further down
                assert main(["new", "filter", path.parent.name]) == 0
            path.write_text(text)
        elif language == "console":
            for line in text.splitlines():
                assert line.startswith("$ ")
                done += carry_out(shlex.split(line[2:]), monkeypatch, capsys)
    assert done >= 8


SENDERS: list[subprocess.Popen[bytes]] = []


def stop_senders() -> None:
    while SENDERS:
        sender = SENDERS.pop()
        sender.kill()
        sender.wait()


def carry_out(words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> int:
    """Carry out one command and return how many commands of imitor that were."""
    if words[0] == "make":
        assert re.search(f"^{words[1]}:", (ROOT / "Makefile").read_text(), re.M)
        return 0
    if words[:3] == ["pip", "install", "-e"]:
        install(Path(words[3]))
        monkeypatch.syspath_prepend(str(Path(words[3]).resolve()))
        importlib.invalidate_caches()
        return 0
    assert words[0] == "imitor", words
    if words[1] == "new" and Path(words[3]).is_dir():
        return 0
    if words[1] == "stream":  # in another terminal, until the page is done
        SENDERS.append(subprocess.Popen([sys.executable, "-m", "imitor.cli", *words[1:], "--quiet"]))
        return 1
    argv = [*words[1:], *(["--frames", FRAMES] if words[1] == "run" else [])]
    status = main(argv)
    printed = capsys.readouterr()
    assert status == 0, f"{shlex.join(words)}\n{printed.err}"
    return 1


def test_the_plugin_of_readme_and_tutorial_is_one_and_short() -> None:
    texts = {
        text
        for page in ("README.md", "docs/tutorial.md")
        for language, text in blocks(ROOT / page)
        if language == "python"
    }
    assert len(texts) == 1
    code = [line for line in texts.pop().splitlines() if line.strip() and not line.startswith("#")]
    assert len(code) <= 15


def test_generated_pages_are_in_step() -> None:
    """When this fails: make generate."""
    done = subprocess.run(
        [sys.executable, str(DOCS / "_generate.py"), "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def cited() -> Iterator[tuple[str, Path]]:
    """Yield every key that code or a page cites, and where."""
    files = [*PAGES]
    for folder, endings in (("framework/imitor", (".py",)), ("plugins", (".py", ".yaml")), ("pipelines", (".yaml",)),
                            ("benchmarks", (".py",)), ("tests", (".py",))):  # fmt: skip
        files += [p for p in (ROOT / folder).rglob("*") if p.suffix in endings]
    for path in files:
        for group in re.findall(
            r"\[([a-z]+\d{4}[a-z]?(?:, [a-z]+\d{4}[a-z]?)*)\]", path.read_text(encoding="utf-8")
        ):
            yield from ((key, path) for key in group.split(", "))


def test_every_cited_key_is_in_the_list_of_references() -> None:
    known = set(re.findall(r"^@\w+\{(\w+),", (DOCS / "references.bib").read_text(encoding="utf-8"), re.M))
    used = list(cited())
    assert {f"{path.relative_to(ROOT)}: {key}" for key, path in used if key not in known} == set()
    assert known - {key for key, _ in used} == set(), "not cited anywhere"


@pytest.mark.parametrize("page", PAGES, ids=[str(p.relative_to(ROOT)) for p in PAGES])
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"^```.*?^```$|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not re.match(r"https?://|#", target):
            assert (page.parent / target.partition("#")[0]).exists(), target


def test_every_page_is_in_the_table_of_contents() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    wanted = [line for line in index.splitlines() if re.fullmatch(r"[a-z_/*]+", line)]
    found = {p for pattern in wanted for p in DOCS.glob(f"{pattern}.md")}
    missing = {p for p in PAGES if p.is_relative_to(DOCS)} - found - {DOCS / "index.md"}
    assert {str(p.relative_to(DOCS)) for p in missing} == set()


def test_make_says_what_it_can_do() -> None:
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in ("install", "demo", "test", "check", "docs", "generate", "lock", "picture"):
        assert re.search(rf"^{target}:.*## ", text, re.M), target
