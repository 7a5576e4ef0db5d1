"""Configuration files: values of options by command, with unknown keys named by file and line.

Top-level keys set an option for every command that has it among the common ones; a key that is a command's name holds
that command's options. ``./dynid.yaml`` wins over the user's file, and ``--config FILE`` stands in for both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from dynid.errors import UnknownKey
from dynid.xdg import LOCAL_CONFIG, config_file

if TYPE_CHECKING:
    from dynid.files.yamlfile import Value


@dataclass(frozen=True)
class Settings:
    """What the configuration files say for one command.

    Attributes:
        values: parameter name to text or list of texts, as on the command line.
        places: parameter name to ``file:line``.
    """

    values: dict[str, str | list[str]] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)


def settings_files(given: Path | None) -> list[Path]:
    """Return the configuration files in force, the strongest last."""
    if given is not None:
        return [given]
    return [path for path in (config_file(), LOCAL_CONFIG) if path.is_file()]


def load_settings(given: Path | None, command: str, keys: Mapping[str, str], common: Sequence[str]) -> Settings:
    """Read what the configuration files say about the options of a command.

    Args:
        given: the file of --config, or None.
        command: name of the command.
        keys: key in the file and name of the parameter that it sets.
        common: names of the options that every command has.

    Raises:
        UnknownKey: a key is neither a common option, a command, nor an option of this command.
    """
    settings = Settings()
    for path in settings_files(given):
        _read(path, command, keys, [name for name in common if name != "config"], settings)
    return settings


def _read(path: Path, command: str, keys: Mapping[str, str], common: Sequence[str], settings: Settings) -> None:
    from dynid.cli.main import COMMANDS
    from dynid.files.yamlfile import read_yaml

    try:
        top = read_yaml(path).mapping([*common, *COMMANDS])
        own = top[command].mapping(tuple(keys)) if command in top and not top[command].is_null else {}
    except UnknownKey as error:
        raise UnknownKey(
            error.what, where=error.where, fix="rename or remove the key; keys are long option names"
        ) from error
    for key, value in {**{k: v for k, v in top.items() if k in common}, **own}.items():
        if not value.is_null:
            settings.values[keys.get(key, key)] = _words(value)
            settings.places[keys.get(key, key)] = value.where


def _words(value: Value) -> str | list[str]:
    return [item.text() for item in value.items()] if value.is_list else value.text()
