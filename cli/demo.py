"""`retarget demo`: the sample walk on two robots, a table, and a page to look at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from retarget.cli import options as o
from retarget.cli.console import Console
from retarget.core.errors import UsageError

if TYPE_CHECKING:
    from retarget.cli.report_page import Section

PAGE = "report.html"
SYNTHETIC = (
    "The walk is synthetic: computed from published gait curves and body proportions, not recorded from a person."
)


@click.command(cls=o.Command, short_help="Convert a sample walk to two robots and write a report.")
@click.option(
    "-o",
    "--output",
    "folder",
    metavar="DIR",
    default="retarget-demo",
    show_default=True,
    help="Folder for the files; made when missing. Earlier demo files in it are replaced.",
)
@click.option(
    "--robot", "robots", multiple=True, type=o.ROBOT, help="Robot; repeat for several. [default: icub and g1]"
)
@o.speech
@click.pass_obj
def demo(console: Console, folder: str, robots: tuple[str, ...]) -> None:
    """Convert the synthetic walk that comes with retarget to iCub and G1.

    Prints a table and writes the trajectories as MCAP, and a page with pictures and plots. Opens nothing.
    """
    from retarget import formats, samples
    from retarget.cli.clip import model_for
    from retarget.cli.report_page import Section, write_page
    from retarget.core import pipeline

    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: can't be made a folder ({error.strerror})") from None
    motion = formats.read_motion(str(samples.sample_path("walk")))
    console.note(f"walk: a synthetic recording, {motion.frames} frames at {motion.rate_hz:g} Hz")
    sections = []
    for robot in dict.fromkeys(robots or ("icub", "g1")):
        model = model_for(robot, motion)
        name = model.profile.name
        with console.progress(name) as progress:
            result = pipeline.convert(motion, model, pipeline.ConvertOptions(), progress)
        output = target / f"walk_{name}.mcap"
        formats.write_trajectory(output, result.trajectory, overwrite=True)
        sections.append(Section(title=f"walk on {name}", result=result, model=model, output=output.name))
    click.echo(_table(sections))
    write_page(target / PAGE, sections, heading="retarget demo: a walk on robots", note=SYNTHETIC, overwrite=True)
    names = ", ".join(section.output for section in sections)
    console.note(f"in {target}: {PAGE} (open it in a browser), {names}")


def _table(sections: Sequence[Section]) -> str:
    from retarget.cli.report_page import overview_values
    from retarget.cli.summary import table

    columns = [overview_values(section.result.metrics, section.result.trajectory.frames) for section in sections]
    head = ["", *(section.model.profile.name for section in sections)]
    return table([head, *([name, *(column[name] for column in columns)] for name in columns[0])])
