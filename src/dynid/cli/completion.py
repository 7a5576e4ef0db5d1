"""``dynid completion SHELL``: the script that makes the shell complete commands and options."""

from __future__ import annotations

import click

from dynid.cli.options import Common, dynid_command


@dynid_command(
    "completion",
    examples=(
        'eval "$(dynid completion bash)"                                   in ~/.bashrc',
        'eval "$(dynid completion zsh)"                                    in ~/.zshrc',
        "dynid completion fish > ~/.config/fish/completions/dynid.fish",
    ),
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def command(common: Common, shell: str) -> None:
    """Print the completion script of a shell."""
    from click.shell_completion import get_completion_class

    from dynid.cli.main import cli

    made = get_completion_class(shell)
    assert made is not None
    script = made(cli, {}, "dynid", "_DYNID_COMPLETE").source()
    common.terminal.answer(script)
    common.terminal.emit_json({"schema": "dynid/completion/1", "shell": shell, "script": script})
