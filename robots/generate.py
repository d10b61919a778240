"""Writes the URDFs that no package ships: `python -m retarget.robots.generate [--out DIR]`. The same bytes every time."""

from __future__ import annotations

import argparse
from pathlib import Path
from types import ModuleType

from retarget.robots import tocabi_figures, urdf_writer

FIGURES: tuple[ModuleType, ...] = (tocabi_figures,)


def files() -> dict[str, str]:
    """File name → text of every URDF of our own."""
    return {
        f"{robot.NAME}.urdf": urdf_writer.urdf(
            robot.NAME, robot.COMMENT, robot.JOINTS, robot.DRIVES, robot.INERTIAS, robot.SHAPES
        )
        for robot in FIGURES
    }


def main() -> None:
    """Writes all of them into `--out`, this folder by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    for name, text in files().items():
        (out / name).write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
