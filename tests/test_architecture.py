"""The order of the rooms, read from the imports themselves, and what a process that only wants help has to load."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOMS = ("cli", "core", "formats", "robots", "samples")

CORE_FOR_FILES = {"calibration", "errors", "field_checks", "rotations", "segments", "timebase", "types"}
"""What of core a file format may know: types and time, no robot and no solver."""

MAY_IMPORT: dict[str, dict[str, set[str] | None]] = {
    # room → other room → its modules that may be imported, None = all
    "cli": {"core": None, "formats": None, "robots": None, "samples": None},
    "formats": {"core": CORE_FOR_FILES},
    "robots": {"core": {"errors", "field_checks", "profile", "segments", "types"}},
    "core": {},
    "samples": {"core": CORE_FOR_FILES},
}

ONLY_IN = {
    "click": {"cli"},
    "matplotlib": {"cli"},
    "av": {"cli"},
    "h5py": {"formats"},
    "mcap": {"formats"},
    "rosbags": {"formats"},
}
HEAVY = {"pinocchio", "placo", "mujoco", "h5py", "rosbags", "mcap", "matplotlib", "numba", "scipy", "daqp"}
HEAVY_AT_LOAD = (
    "core.solve.",
    "core.replay.",
    "cli.figures",
    "cli.calibration_picture",
    "cli.stick_figures",
    "cli.report_page",
    "cli.inspection_figures",
    "cli.inspection_page",
    "cli.comparison_figures",
    "cli.comparison_page",
    "cli.validation_figures",
    "cli.validation_page",
    "cli.validation_views",
)


@dataclass(frozen=True)
class Import:
    """One import statement's target: `module` full dotted. when: "load" = whenever its file is imported, "call", or "types"."""

    importer: str
    module: str
    line: int
    when: str

    def __str__(self) -> str:
        return f"retarget.{self.importer}:{self.line} imports {self.module}"


def source_files(room: str) -> list[Path]:
    spec = find_spec(f"retarget.{room}")
    assert spec is not None
    assert spec.submodule_search_locations
    return sorted(Path(next(iter(spec.submodule_search_locations))).rglob("*.py"))


def imports_of(room: str, path: Path) -> Iterator[Import]:
    folder = source_files(room)[0].parent
    parts = path.relative_to(folder).with_suffix("").parts
    importer = ".".join([room, *(part for part in parts if part != "__init__")])

    def walk(node: ast.AST, when: str) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            now = when
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) and when == "load":
                now = "call"
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
                for statement in child.body:
                    yield from walk(ast.Module([statement], []), "types")
                for statement in child.orelse:
                    yield from walk(ast.Module([statement], []), when)
                continue
            if isinstance(child, ast.Import):
                yield from (Import(importer, alias.name, child.lineno, now) for alias in child.names)
            elif isinstance(child, ast.ImportFrom):
                assert child.level == 0, f"{path}:{child.lineno}: relative import; write the full name"
                yield from (
                    Import(importer, f"{child.module}.{alias.name}", child.lineno, now) for alias in child.names
                )
            yield from walk(child, now)

    yield from walk(ast.parse(path.read_text(encoding="utf-8")), "load")


IMPORTS = [entry for room in ROOMS for path in source_files(room) for entry in imports_of(room, path)]


def test_the_imports_were_found() -> None:
    """The tests below would hold for an empty list as well."""
    assert {entry.importer.split(".")[0] for entry in IMPORTS} == set(ROOMS)
    assert {entry.when for entry in IMPORTS} == {"load", "call", "types"}
    assert any(entry.module.startswith("pinocchio") for entry in IMPORTS)


def test_rooms_import_only_the_rooms_below_them() -> None:
    wrong = []
    for entry in IMPORTS:
        if not entry.module.startswith("retarget."):
            continue
        room, (_, target, *rest) = entry.importer.split(".")[0], entry.module.split(".")
        if target == room or target not in ROOMS:
            continue
        allowed = MAY_IMPORT[room].get(target, set())
        if allowed is not None and (not rest or rest[0] not in allowed):
            wrong.append(str(entry))
    assert wrong == []


@pytest.mark.parametrize("library", sorted(ONLY_IN))
def test_libraries_stay_in_their_room(library: str) -> None:
    found = [entry for entry in IMPORTS if entry.module.split(".")[0] == library]
    assert found, f"nothing imports {library}: remove it from this test and from the dependencies"
    assert [str(entry) for entry in found if entry.importer.split(".")[0] not in ONLY_IN[library]] == []


def test_heavy_libraries_load_only_with_the_modules_that_compute_with_them() -> None:
    """Everything else imports them, and these modules, inside functions."""
    needs: dict[str, set[str]] = {}
    for entry in IMPORTS:
        if entry.when == "load":
            needs.setdefault(entry.importer, set()).add(entry.module)
    heavy = {name for name, modules in needs.items() if {m.split(".")[0] for m in modules} & HEAVY}
    while True:
        reached = {f"retarget.{name}" for name in heavy}
        more = {
            n for n, modules in needs.items() if any(m in reached or m.rpartition(".")[0] in reached for m in modules)
        }
        if more <= heavy:
            break
        heavy |= more
    assert heavy, "the test looks for nothing"
    assert {name for name in heavy if not name.startswith(HEAVY_AT_LOAD)} == set()


def loaded_by(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter holds after `code`."""
    script = f"import sys, json\n{code}\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in json.loads(done.stdout.splitlines()[-1])}


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["--version"],
        ["convert", "--help"],
        ["calibrate", "--help"],
        ["compare", "--help"],
        ["validate", "--help"],
        ["inspect", "--help"],
        ["robots", "--help"],
        ["demo", "--help"],
    ],
)
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    code = f"""
from retarget.cli.main import cli
try:
    cli.main({arguments!r})
except SystemExit as stop:
    assert not stop.code
"""
    assert loaded_by(code) & (HEAVY | {"numpy"}) == set()


@pytest.mark.parametrize(
    "module",
    ["core.types", "core.pipeline", "core.robot_model", "core.batch", "formats", "robots", "samples", "cli.convert"],
)
def test_importing_a_door_loads_nothing_heavy(module: str) -> None:
    assert loaded_by(f"import retarget.{module}") & HEAVY == set()


def test_nothing_lands_under_a_bare_name() -> None:
    """The folders of the checkout are installed as `retarget.*` only."""
    code = "import importlib.util\nassert not [n for n in ('cli', 'core', 'formats', 'robots', 'samples') if importlib.util.find_spec(n)]"
    subprocess.run([sys.executable, "-P", "-c", code], check=True, cwd="/")
