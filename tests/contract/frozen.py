"""Run the situations and say what they give: exit status, codes on stderr, keys of the answer, names of files.

``PYTHONPATH=src:tests python tests/contract/frozen.py`` writes contract.json anew from the code as it is: only where
the contract itself was changed on purpose.
"""

import csv
import json
import re
import tempfile
from pathlib import Path

import yaml
from situations import (
    BEFORE,
    CHAPTERS,
    COPIES,
    MAY_BE_EMPTY,
    OPEN_MAPS,
    PLACES,
    files,
    short_log,
)

from dynid.files.artifact import read_artifact
from runner import Runner

TABLE = Path(__file__).with_name("contract.json")
#: What a machine without ROS says, and one with ROS whose master does not run.
NO_ROS = {"E601", "E602"}


def keys(value, within="", name=""):
    """Return the paths of all keys in an answer: ``links[].com_m``; keys of an open map are one ``*``."""
    if isinstance(value, list):
        return set().union(*(keys(each, f"{within}[]") for each in value))
    if not isinstance(value, dict):
        return set()
    found = set()
    for key, each in value.items():
        path = f"{within}.{'*' if name in OPEN_MAPS else key}".lstrip(".")
        found.add(path)
        if key not in COPIES:
            found |= keys(each, path, "*" if name in OPEN_MAPS else key)
    return found


def lost(then, now):
    """Return the keys that are no longer there, but for those in something that is empty this time and may be."""
    here = set(now)

    def empty(path):
        parts = re.findall(r"[^.\[\]]+|\[\]", path)
        return any(
            part in MAY_BE_EMPTY
            and not any(each.startswith((f"{inside}[]", f"{inside}.")) for each in here)
            for i, part in enumerate(parts)
            for inside in [".".join(parts[: i + 1]).replace(".[]", "[]")]
        )

    return [path for path in then if path not in here and not empty(path)]


def contents(path):
    """Return the keys of a YAML file, the columns of a table, the schema of a result; nothing for other files."""
    if path.suffix == ".npz":
        return [read_artifact(path).header["schema"]]
    if path.suffix == ".yaml":
        return sorted(keys(yaml.safe_load(path.read_text())))
    if path.suffix == ".csv":
        with path.open(newline="") as stream:
            return next(csv.reader(stream), [])
    return []


def seen(folder):
    """Return every file below a folder with the time of its last change."""
    return {
        str(path.relative_to(folder)): path.stat().st_mtime_ns
        for path in folder.rglob("*")
        if path.is_file()
    }


def situation(dynid, line):
    """Run one command line and return what of it is contract."""
    before = seen(dynid.folder)
    run = dynid(*line.format(**PLACES).split())
    after = seen(dynid.folder)
    found = {
        "status": run.status,
        "errors": [
            "no ROS" if code in NO_ROS else code
            for code in re.findall(r"^error\[(E\d+)\]", run.err, re.M)
        ],
        "answered": bool(run.out),
    }
    if "--json" in line.split():
        answer = json.loads(run.out)
        found |= {"schema": answer["schema"], "keys": sorted(keys(answer))}
    elif "--json-lines" in line.split():
        answers = [json.loads(each) for each in run.out.splitlines()]
        found |= {"schema": answers[0]["schema"], "keys": sorted(set().union(*map(keys, answers)))}
    if run.status <= 1:
        wrote = sorted(name for name, when in after.items() if before.get(name) != when)
        found["files"] = {name: contents(dynid.folder / name) for name in wrote}
    return found


def chapter(name, folder):
    """Run a chapter in an empty folder and return its situations by their command line."""
    for each in ("work", "home"):
        (folder / each).mkdir(parents=True)
    dynid = Runner(folder / "work", folder / "home")
    dynid.env["ROS_MASTER_URI"] = "http://127.0.0.1:9"  # where nobody is
    files(dynid.folder)
    for line in BEFORE.get(name, []):
        assert dynid(*line.format(**PLACES).split()).status == 0, line
    if (dynid.folder / "log.csv").exists():
        short_log(dynid.folder)
    found = {}
    for line in CHAPTERS[name]:
        again = sum(each.split(" #")[0] == line for each in found)
        found[line + (f" #{again + 1}" if again else "")] = situation(dynid, line)
    return found


def options(dynid):
    """Return all commands with the names of their options, as their help shows them."""
    words = dynid("-h").out.split("Commands:")[1].split("\n\n")[0]
    commands = re.findall(r"^  (\S+)", words, re.MULTILINE)
    return {
        name: sorted(
            set(re.findall(r"(?<=[ /])--?[a-z][a-z-]*", dynid(name, "-h").out.split("Options:")[1]))
        )
        for name in commands
    }


def errors(dynid):
    """Return the exit status of every error code."""
    codes = json.loads(dynid("explain", "--json").out)["codes"]
    return {
        code: int(page["exit"].split(",")[0])
        for code, page in codes.items()
        if code.startswith("E")
    }


def frozen(folder):
    """Return the whole table, measured in an empty folder."""
    dynid = Runner(folder, folder)
    chapters = {each: chapter(each, folder / str(i)) for i, each in enumerate(CHAPTERS)}
    return {"options": options(dynid), "errors": errors(dynid), "situations": chapters}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        TABLE.write_text(json.dumps(frozen(Path(place)), indent=1) + "\n")
