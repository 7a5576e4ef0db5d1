"""README and docs cannot rot: commands run and print what the page shows, links exist, every code is listed."""

import re

import pytest
from blocks import RECORDINGS, ROOT, alike, commands, folder_for, pages, run

import forkserver
from dynid.cli.commands import COMMANDS
from dynid.codes import codes

#: Status of the commands that show a mistake on purpose, by the code they show.
MISTAKE = re.compile(r"^error\[(E\d+)\]", re.M)
LINK = re.compile(r"\]\(([^)\s#]+)(#[^)\s]+)?\)")
WITH_COMMANDS = [page for page in pages() if commands(page.read_text())]
#: Pages with recordings of real arms.
REAL = [
    page
    for page in WITH_COMMANDS
    if "$ dynid identify kuka_lwr4plus recordings/" in page.read_text()
]


def name(page):
    return str(page.relative_to(ROOT))


#: Commands that search for what a model lacks.
SEARCH = re.compile("dynid (gap|demo)")


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.data] * (page in REAL)) for page in WITH_COMMANDS],
    ids=name,
)
def test_every_command_of_a_page_prints_what_the_page_shows(page, tmp_path):
    if page in REAL and not RECORDINGS.is_dir():
        pytest.skip("the recordings (../shared/data) are not here")
    prints(commands(page.read_text()), tmp_path)


def test_commands_of_the_readme_but_for_searches_print_what_it_shows(tmp_path):
    shown = commands((ROOT / "README.md").read_text())
    prints([command for command in shown if not SEARCH.match(command.line)], tmp_path)


def prints(shown, place):
    folder = folder_for(place, forkserver.program())
    for command in shown:
        status, output = run(command.line, folder)
        assert "Traceback" not in output
        assert (status != 0) is bool(MISTAKE.search(command.output)), f"$ {command.line}\n{output}"
        assert alike(command.output, output), f"$ {command.line}\n{output}"


@pytest.mark.parametrize("page", pages(), ids=name)
def test_every_link_of_a_page_leads_somewhere(page):
    for target, anchor in LINK.findall(page.read_text()):
        if target.startswith(("http://", "https://", "mailto:")):
            continue
        path = (page.parent / target).resolve()
        assert path.exists(), f"{target} in {name(page)}"
        assert not anchor or anchor[1:] in anchors(path), f"{target}{anchor} in {name(page)}"


def anchors(path):
    headings = re.findall(r"^#+ (.+)$", path.read_text(), re.M)
    return {re.sub(r"[^a-z0-9 -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_page_is_reachable_from_the_index():
    reached, todo = set(), [ROOT / "docs/index.md"]
    while todo:
        page = todo.pop()
        if page in reached:
            continue
        reached.add(page)
        todo += [
            (page.parent / t).resolve()
            for t, _ in LINK.findall(page.read_text())
            if t.endswith(".md")
        ]
    assert set((ROOT / "docs").rglob("*.md")) <= reached


def test_every_code_is_on_the_page_of_errors():
    text = (ROOT / "docs/reference/errors.md").read_text()
    assert [code for code in codes() if code not in text] == []


def test_every_code_on_a_page_exists():
    for page in pages():
        assert set(re.findall(r"\b[EW]\d{3}\b", page.read_text())) <= set(codes()), name(page)


def test_every_command_named_in_the_pages_exists():
    known = {*COMMANDS, "help", "COMMAND"}
    for page in pages():
        shown = re.findall(r"`dynid ([a-zA-Z-]+)", page.read_text()) + re.findall(
            r"^\$ dynid ([a-z-]+)", page.read_text(), re.M
        )
        assert set(shown) <= known, name(page)


def test_pages_that_messages_point_to_exist():
    """In the folder of the documentation, and by the name that ``dynid explain`` knows them by."""
    source = "".join(path.read_text() for path in (ROOT / "src/dynid").rglob("*.py"))
    for target in set(re.findall(r"docs/[a-z0-9/-]+\.md", source)):
        assert (ROOT / target).is_file(), target
    named = set(re.findall(r"dynid explain ([a-z][a-z0-9-]+)", source))
    assert (
        {"robot-file", "log-format"}
        <= named
        <= {path.stem for path in (ROOT / "docs").rglob("*.md")}
    )


def test_pictures_of_the_docs_are_used():
    text = "".join(page.read_text() for page in pages())
    for picture in (ROOT / "docs/images").iterdir():
        assert picture.name in text


def test_rows_on_the_page_of_exciting_motions_are_those_of_the_benchmark():
    made = (ROOT / "benchmarks/excitation.md").read_text().splitlines()
    page = (ROOT / "docs/explanation/exciting-motions.md").read_text().splitlines()
    shown = [line for line in page if line[:1] == "|"]
    assert len(shown) > 20
    assert set(shown) <= set(made)


def test_commands_stand_in_blocks_that_are_run_or_said_to_need_more():
    """An indented block would be neither."""
    for page in pages():
        outside = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.M | re.S)
        found = re.findall(r"^ {4,}\$?\s*(dynid|rosmaster|python3?) .*$", outside, re.M)
        assert found == [], name(page)
