"""``dynid completion SHELL``: the script that makes the shell complete commands and options."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from dynid.answer import Answer
from dynid.cli.options import dynid_command
from dynid.cli.session import Session


@dynid_command(
    "completion",
    examples=(
        'eval "$(dynid completion bash)"                                   in ~/.bashrc',
        'eval "$(dynid completion zsh)"                                    in ~/.zshrc',
        "dynid completion fish > ~/.config/fish/completions/dynid.fish",
    ),
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def command(session: Session, shell: str) -> Answer:
    """Print the completion script of a shell."""
    made, root = get_completion_class(shell), click.get_current_context().find_root().command
    assert made is not None
    script = made(root, {}, "dynid", "_DYNID_COMPLETE").source()
    session.answer(script)
    return Answer({"schema": "dynid/completion/1", "shell": shell, "script": script})
