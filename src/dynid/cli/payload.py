"""The load on the last link: what ``dynid identify --payload-from`` adds to an identification."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common
from dynid.files.artifact import write_text

if TYPE_CHECKING:
    from dynid.estimation.payload import Payload
    from dynid.estimation.result import Identification, StoredResult


def as_before(options: dict[str, Any], before: StoredResult) -> dict[str, Any]:
    """Return the options with the signals treated as in an earlier result, where nothing else was asked for."""
    same = {"cutoff": repr(before.cutoff), "delay": repr(before.delay)}
    return {**options, **{key: value for key, value in same.items() if options[key] == "auto"}}


def add_payload(
    common: Common, folder: Path, found: Identification, unloaded: StoredResult, facts: dict[str, Any]
) -> None:
    """Find the load, write payload.yaml, print it, and add it to the JSON answer."""
    import yaml

    from dynid.estimation.payload import find_payload

    payload = find_payload(found, unloaded)
    common.terminal.findings(payload.findings())
    facts["payload"] = payload.facts()
    facts["findings"] = [*facts["findings"], *(asdict(finding) for finding in payload.findings())]
    # Why these keys: the text is what `tool:` of a robot file holds.
    body = {"mass": payload.body.mass, "com": list(payload.body.com)}
    tool = {**body, "inertia_com": facts["payload"]["inertia_com_kg_m2"]}
    path = folder / "payload.yaml"
    write_text(path, yaml.safe_dump({"tool": tool}, sort_keys=False, default_flow_style=None, width=120))
    common.terminal.wrote(path)
    facts["wrote"] = [*facts["wrote"], path]
    show_payload(common, payload)


def show_payload(common: Common, payload: Payload) -> None:
    """Print mass, centre of mass and inertia with their errors."""
    errors = payload.std_error
    names = ("mass", "com x", "com y", "com z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
    units = ("kg", *("m",) * 3, *("kg m^2",) * 6)
    values = (payload.body.mass, *payload.body.com, *payload.body.inertia_com)
    common.terminal.answer()
    common.terminal.answer("load on the last link, in its frame (inertia about the centre of mass)")
    rows = [
        [name, f"{value:.4g}", f"{error:.2g}", unit]
        for name, value, error, unit in zip(names, values, errors, units, strict=True)
    ]
    common.terminal.table(["load", "value", "std error", "unit"], rows)
