"""What a page writes in code font exists: files and folders of the project, names in a module, options of commands."""

import importlib
import re
from pathlib import Path

import click
import pytest
from blocks import ROOT, pages

from dynid.cli.main import available, cli

PAGES = [*pages(), ROOT / "CONTRIBUTING.md", *sorted((ROOT / "benchmarks").glob("*.md"))]
#: Where a path on a page may begin, beside the folder of the page.
STARTS = (
    ROOT,
    ROOT / "src",
    ROOT / "src/dynid",
    ROOT / "tests",
    ROOT / "docs",
    ROOT / "benchmarks",
)
#: Files with these endings belong to the project; files of a user have others, or stand in no folder.
OURS = (".py", ".md", ".svg", ".ipynb", ".toml")
#: Folders that a command writes or that a reader of the page has.
OF_READERS = {"log/", "logs/", "out/", "validation/", "my_arms/", "draws/"}
#: Files that dynid writes.
WRITTEN = {"effects.py"}
#: Options of other programs, and of the project's own scripts outside of ``dynid``.
OTHER_OPTIONS = {
    "--exclude-editable",
    "--requirement",  # pip
    "--nthreads",
    "--nworkers",
    "--tls-cert",  # dask worker
    "--core",  # rosmaster
    "--data",
    "--minutes",
    "--seeds",
    "--unchanged",  # scripts in benchmarks/
    "--stdin",  # ros2 action
}

#: A word that stands for another one; README, CHANGELOG and CONTRIBUTING are files.
PLACEHOLDER = re.compile(r"\b(NAME|PAGE|FOLDER|COMMAND|FILE)\b")
FENCE = re.compile(r"^```.*?^```$", re.M | re.S)
SPAN = re.compile(r"`([^`\n]+)`")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*[a-z0-9]")
#: A module and the names in it that a page lists: `model/reduce.py`: `reduce`, `Reduction`.
LISTED = re.compile(r"`([\w/]+\.py)`: ((?:`[\w.]+`(?:, )?)+)")


def spans(page):
    return SPAN.findall(FENCE.sub("", page.read_text()))


def alternatives(word):
    """Return the words that ``a/{b,c}.py`` stands for."""
    found = re.match(r"(.*)\{(.+)\}(.*)", word)
    return [f"{found[1]}{part}{found[3]}" for part in found[2].split(",")] if found else [word]


def is_there(word, page):
    if any(list(start.glob(word)) for start in (*STARTS, page.parent)):
        return True
    return "/" not in word and any((ROOT / "src/dynid").rglob(word))


def named_files(page):
    """Return the files and folders of the project that a page names; ``NAME`` is a placeholder."""
    for span in spans(page):
        for word in re.findall(r"[\w./{},*-]+", span):
            folder = word.endswith("/") and len(word) > 2 and not word.startswith(("/", "~"))
            written = word in WRITTEN or "out/" in word
            if (folder and word not in OF_READERS and not written) or (
                word.endswith(OURS) and not written
            ):
                yield from (
                    each
                    for each in alternatives(word)
                    if not PLACEHOLDER.search(str(Path(each).with_suffix("")))
                )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_and_modules_that_a_page_names_exist(page):
    assert [word for word in named_files(page) if not is_there(word.removeprefix("./"), page)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_names_that_a_page_lists_for_a_module_are_in_it(page):
    for module, names in LISTED.findall(page.read_text()):
        path = next(start / module for start in STARTS if (start / module).is_file())
        for name in re.findall(r"\w+", names.replace(".", " ")):
            assert re.search(rf"\b{name}\b", path.read_text()), f"{name} in {module}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_dotted_names_on_a_page_can_be_imported(page):
    for span in spans(page):
        for dotted in re.findall(r"\bdynid(?:\.[A-Za-z_]\w*)+", span):
            if not dotted.endswith(
                (".yaml", "dynid.fresh", "dynid.start")
            ):  # a file; a fixture of the tests
                found(dotted)


def found(dotted):
    """Return what a dotted name means; the longest part that is a module is imported, the rest are attributes."""
    parts = dotted.split(".")
    for k in range(len(parts), 0, -1):
        try:
            value = importlib.import_module(".".join(parts[:k]))
        except ModuleNotFoundError:
            continue
        for name in parts[k:]:
            value = getattr(value, name)
        return value
    raise AssertionError(dotted)


def options():
    context = click.Context(cli)
    params = [param for name in available() for param in cli.get_command(context, name).params]
    return {word for param in params for word in (*param.opts, *param.secondary_opts)} | {
        "--help",
        "--version",
    }


def test_options_on_the_pages_exist():
    known = options() | OTHER_OPTIONS
    text = {page: page.read_text() for page in PAGES}
    named = {
        page: {word for word in OPTION.findall(body) if word not in known}
        for page, body in text.items()
    }
    assert {str(page.relative_to(ROOT)): words for page, words in named.items() if words} == {}


def test_exceptions_are_still_needed():
    text = "".join(page.read_text() for page in PAGES)
    assert {word for word in OTHER_OPTIONS if not re.search(rf"{word}\b", text)} == set()
    assert {word for word in OTHER_OPTIONS if word in options()} == set()
