"""``dynid doctor``: what works on this machine and what does not, and where each option's value comes from."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import COMMON_NAMES, Command, Common, configure, dynid_command, key_of, known_keys
from dynid.cli.settings import LOCAL, load_settings, settings_files
from dynid.cli.versions import version_of
from dynid.errors import ExitStatus
from dynid.xdg import cache_folder, config_file

if TYPE_CHECKING:
    from dynid.cli.terminal import Cell

#: What dynid cannot do without.
REQUIRED = ("numpy", "scipy", "sympy", "pyyaml", "matplotlib", "click", "rich", "rosbags", "jinja2")
#: Value of --config that means: show the configuration.
SHOW = Path("?show")


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        name: what.
        ok: whether it works; None where it is only information.
        value: what was found.
        lost: what does not work without it.
    """

    name: str
    ok: bool | None
    value: str
    lost: str = ""


def checks() -> Iterator[Check]:
    """Look at Python, packages, simulator, ROS, display and folders."""
    yield Check("Python", sys.version_info >= (3, 10), platform.python_version(), "dynid needs Python 3.10 or newer")
    for package in REQUIRED:
        version = version_of(package)
        yield Check(package, version is not None, version or "absent", f"dynid as a whole: pip install {package}")
    bullet = version_of("pybullet")
    lost = 'preview, collision check, demo: pip install "pybullet>=3.2.5" (wheels exist for Python 3.8-3.11)'
    yield Check("PyBullet", bullet is not None, bullet or "absent", lost)
    yield from ros_checks()
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    yield Check("display", bool(display), display or "none", "preview window: pictures are saved instead")
    yield _folder("working folder", Path.cwd(), "results: give another folder with --out")
    cache = cache_folder()
    yield _folder("cache", cache, "models are built anew each time", f"{_size(cache) / 1e6:.1f} MB")
    for file in (LOCAL, config_file()):
        yield Check("configuration", None, f"{file} {'is read' if file in settings_files(None) else 'does not exist'}")


def ros_checks() -> Iterator[Check]:
    """Look for ROS 1 where ``dynid record`` would find it, and for a master."""
    from dynid.drivers.ros import APT, master_uri, missing_modules, ros_folders

    missing = missing_modules()
    lost = f"record (reading bags works without): {APT}; or set DYNID_ROS_PATH to the folder that holds rospy"
    found = (
        f"absent: {', '.join(missing)}"
        if missing
        else f"present, looked for in {', '.join(ros_folders()) or 'sys.path'}"
    )
    yield Check("ROS 1", not missing, found, lost)
    uri = master_uri()
    answered = master_answers(uri)
    state = "answers" if answered else "does not answer"
    yield Check("ROS master", answered, f"{uri} {state}", "record: start rosmaster --core, or set ROS_MASTER_URI")


def master_answers(uri: str) -> bool:
    """Return whether something listens at a ROS master's address, within a limit that holds for name look-up too."""
    from dynid.drivers.ros import ping_master

    try:
        ping_master(uri)
    except OSError:
        return False
    return True


def _folder(name: str, path: Path, lost: str, note: str = "") -> Check:
    nearest = next(p for p in (path, *path.parents) if p.exists())
    writable = os.access(nearest, os.W_OK)
    words = [str(path), *([note] if note else []), "" if writable else "cannot be written"]
    return Check(name, writable, "  ".join(word for word in words if word), lost)


def _size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) if folder.is_dir() else 0


@dataclass(frozen=True)
class Setting:
    """One option's value and where it comes from."""

    command: str
    option: str
    value: Any
    source: str


def settings(given: Path | None) -> Iterator[Setting]:
    """Yield the common options, then those options of the commands that no longer have their default."""
    from dynid.cli.main import LazyGroup, cli

    assert isinstance(cli, LazyGroup)
    group = click.Context(cli)
    for name in ["doctor", *(name for name in cli.list_commands(group) if name != "doctor")]:
        command = cli.get_command(group, name)
        assert isinstance(command, Command)
        keys = known_keys(command)
        found = load_settings(given, name, keys)
        for param in command.params:
            if not isinstance(param, click.Option) or key_of(param) not in keys:
                continue
            value, source = _resolved(param, found.values, found.places)
            if name == "doctor" and param.name in COMMON_NAMES:
                yield Setting("", key_of(param), value, source)
            elif source != "default" and param.name not in COMMON_NAMES:
                yield Setting(name, key_of(param), value, source)


def _resolved(param: click.Option, values: dict[str, Any], places: dict[str, str]) -> tuple[Any, str]:
    ctx = click.get_current_context()
    name = str(param.name)
    if param in ctx.command.params and ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
        return ctx.params[name], "command line"
    for variable in param.envvar if isinstance(param.envvar, list) else []:
        if os.environ.get(variable):
            return os.environ[variable], variable
    if name in values:
        return values[name], places[name]
    default = param.get_default(ctx)
    return default if isinstance(default, (bool, int, float, str)) else None, "default"


def _show_or_configure(ctx: click.Context, param: click.Parameter, value: Path | None) -> Path | None:
    configure(ctx, param, None if value == SHOW else value)
    return value


def _show_settings(common: Common) -> None:
    terminal = common.terminal
    found = list(settings(None if common.config == SHOW else common.config))
    terminal.emit_json({"schema": "dynid/doctor/1", "settings": [asdict(setting) for setting in found]})
    rows = [(f"{s.command} {s.option}".strip(), "-" if s.value is None else str(s.value), s.source) for s in found]
    terminal.table(("option", "value", "source"), rows, numbers=False)
    terminal.stage("note", "options of single commands are listed when they differ from their default")


@dynid_command(
    "doctor",
    examples=(
        "dynid doctor               what works and what does not",
        "dynid doctor --config      each option's value",
    ),
    config=click.option(
        "--config",
        type=click.Path(dir_okay=False, path_type=Path),
        metavar="[FILE]",
        is_flag=False,
        flag_value=str(SHOW),
        is_eager=True,
        callback=_show_or_configure,
        help="Show each option's value and source, those of FILE instead of ./dynid.yaml and the user's.",
    ),
)
def command(common: Common) -> ExitStatus:
    """Look at this machine: Python, packages, simulator, ROS, display, folders, configuration."""
    if common.config is not None:
        _show_settings(common)
        return ExitStatus.DONE
    terminal = common.terminal
    found = list(checks())
    missing = [check for check in found if check.ok is False]
    broken = [check.name for check in missing if check.name in ("Python", *REQUIRED)]
    terminal.emit_json(
        {
            "schema": "dynid/doctor/1",
            "checks": [asdict(check) for check in found],
            "works": [check.name for check in found if check.ok],
            "does_not_work": [check.name for check in missing],
        }
    )
    words: dict[bool | None, Cell] = {True: "ok", False: ("missing", "yellow"), None: ""}
    terminal.table(("what", "state", "found"), [(c.name, words[c.ok], c.value) for c in found], numbers=False)
    terminal.answer()
    terminal.fact("works", ", ".join(check.name for check in found if check.ok))
    for check in missing:
        terminal.fact("does not", f"{check.name}; lost: {check.lost}")
    return ExitStatus.MACHINE if broken else ExitStatus.DONE
