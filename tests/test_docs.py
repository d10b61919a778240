"""The documentation says what the program does: generated pages are up to date, and commands and links in the others exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest
from retarget import formats
from retarget.cli import docs
from retarget.cli.main import cli
from retarget.core import pipeline

ROOT = Path(__file__).parents[1]
WRITTEN = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize("name", docs.PAGES)
def test_generated_pages_are_up_to_date(name: str) -> None:
    committed = (ROOT / "docs" / name).read_text(encoding="utf-8")
    assert committed == docs.PAGES[name](), "run: python -m retarget.cli.docs docs"


def commands_in(path: Path) -> list[list[str]]:
    """Every `retarget …` in the page's code, its pipes and shell variables apart."""
    code = re.findall(r"```[a-z]*\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
    code += re.findall(r"`(retarget [^`]+)`", path.read_text(encoding="utf-8"))
    found = []
    for line in "\n".join(code).splitlines():
        for part in re.split(r"&&|\|\s|;", line.split(" #")[0]):
            if part.strip().startswith("retarget ") and "[" not in part:
                found.append(shlex.split(part.strip()))
    return found


def resolve(words: list[str]) -> tuple[click.Command, list[str]]:
    """The command that `words` call, and the words after it."""
    command: click.Command = cli
    context, rest = click.Context(cli, info_name="retarget"), words[1:]
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        inner = command.get_command(context, rest[0])
        assert inner is not None, f"no command '{rest[0]}' in: {shlex.join(words)}"
        command, rest = inner, rest[1:]
    return command, rest


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.name)
def test_commands_in_the_documentation_exist(path: Path) -> None:
    for words in commands_in(path):
        command, rest = resolve(words)
        known = {name for parameter in command.params for name in parameter.opts} | {"--help", "-h"}
        options = {word.split("=")[0] for word in rest if re.match(r"--?[a-zA-Z]", word)}
        assert options <= known, f"{options - known} in: {shlex.join(words)}"


def test_the_readme_shows_commands() -> None:
    assert ["retarget", "demo"] in commands_in(ROOT / "README.md")
    assert len(commands_in(ROOT / "README.md")) >= 5


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.name)
def test_links_lead_somewhere(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text)
    headings = {
        re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    }
    for target in targets:
        if target.startswith(("https://", "http://")):
            continue
        file, _, anchor = target.partition("#")
        assert not file or (path.parent / file).exists(), f"{path.name}: {target}"
        assert file or anchor in headings, f"{path.name}: {target}"


def option_help(name: str) -> str:
    command, _ = resolve(["retarget", "convert"])
    return next(p.help or "" for p in command.params if isinstance(p, click.Option) and name in p.opts)


def test_help_names_every_choice() -> None:
    """Registries are not asked for help texts, so these could fall behind."""
    for name, format_ in formats.available().items():
        assert format_.write_trajectory is None or name in option_help("--format")
    for style in formats.available()["csv"].styles:
        assert style in option_help("--csv-style")
    for mapping in pipeline.mapping_names():
        assert mapping in option_help("--mapping")
    command, _ = resolve(["retarget", "convert"])
    choices = {p.name: p.type.choices for p in command.params if isinstance(p.type, click.Choice)}
    assert tuple(choices["base"]) == pipeline.BASE_CHOICES
    assert tuple(choices["kernel"]) == pipeline.KERNEL_CHOICES


def test_no_page_holds_a_path_of_a_machine() -> None:
    for path in WRITTEN:
        assert not re.search(r"/(home|root|tmp|work|Users)/", path.read_text(encoding="utf-8")), path.name
