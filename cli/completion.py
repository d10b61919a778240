"""`retarget completion`: shell completion of commands, options, robots, mappings and formats."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class
from retarget.cli.main import cli


@click.command(short_help="Print the script that teaches a shell to complete.")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the script that teaches SHELL to complete commands, options, robots, mappings and formats.

    \b
      eval "$(retarget completion bash)"     # in ~/.bashrc
      eval "$(retarget completion zsh)"      # in ~/.zshrc
      retarget completion fish > ~/.config/fish/completions/retarget.fish
    """
    kind = get_completion_class(shell)
    if kind is None:
        raise click.UsageError(f"this version of click has no completion for {shell}")
    click.echo(kind(cli, {}, "retarget", "_RETARGET_COMPLETE").source())
