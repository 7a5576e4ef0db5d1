"""Results of many arms are put in order by their folders or a list; what cannot be read is named; the page is safe."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from dynid.errors import NotAnArtifact, WrongUsage
from dynid.estimation.fleet import History, look_at
from dynid.reports.fleet_page import fleet_page
from dynid.workflows.fleet import FleetOptions, _day, _text_of, fleet, ordered, runs_of


@pytest.fixture
def runs(tmp_path, result, other, scaled):
    """Two arms in five runs each; the elbow of the second pulls 5 % more from the third run on."""
    for arm in ("left", "right"):
        for k in range(5):
            folder = tmp_path / arm / f"2026-03-{8 + k:02d}"
            folder.mkdir(parents=True)
            found = scaled if arm == "right" and k >= 2 else (result, other)[k % 2]
            found.save(folder / "parameters.npz")
    return tmp_path


def test_arm_and_day_come_from_the_folders_in_any_order(runs):
    paths = sorted(runs.glob("*/*"), reverse=True)
    every = ordered([run for path in paths for run in runs_of(path)])
    assert [(run.arm, run.time) for run in every if run.arm == "left"] == [
        ("left", f"2026-03-{8 + k:02d}") for k in range(5)
    ]
    assert every[1].day - every[0].day == 1.0


def test_a_folder_of_each_night_with_an_arm_in_each_is_understood_and_its_own_output_is_not_read(
    runs,
):
    (left,), (right,) = runs_of(Path("out/2026-03-08/arm12")), runs_of(Path("out/arm12/2026-03-08"))
    assert (
        (left.arm, left.time, left.day)
        == (right.arm, right.time, right.day)
        == ("arm12", "2026-03-08", right.day)
    )
    paths = sorted(runs.glob("*/*"))
    wrote = fleet(paths).save(runs / "fleet")
    assert fleet([*paths, *wrote]).facts() == fleet(paths).facts()


def test_times_that_are_names_are_put_in_order_with_their_numbers():
    runs = [run for k in (10, 9, 1) for run in runs_of(Path(f"arm/run{k}/parameters.npz"))]
    assert [(run.time, run.day) for run in ordered(runs)] == [
        ("run1", 0.0),
        ("run9", 1.0),
        ("run10", 2.0),
    ]


@pytest.mark.parametrize(
    ("text", "apart"),
    [("2026-03-08T06:00", 0.25), ("20260308", 0.0), ("2026-03-08_12-00", None), ("7", None)],
)
def test_dates_and_numbers_are_read(text, apart):
    (run,), (day,) = (
        runs_of(Path(f"arm/{text}/parameters.npz")),
        runs_of(Path("arm/2026-03-08/parameters.npz")),
    )
    if text == "7":
        assert run.day == 7.0
    elif apart is not None:
        assert run.day - day.day == pytest.approx(apart)


def test_a_change_of_one_arm_is_named_with_its_day_and_the_other_arm_is_left_alone(runs):
    found = fleet(sorted(runs.glob("*/*")))
    assert found.changed == ["right"]
    assert {change["since"] for change in found.facts()["changed"]} == {"2026-03-10"}
    assert (found.arms, found.runs) == (2, 10)
    json.dumps(found.facts())
    csv, page = found.save(runs / "out")
    assert csv.read_text().splitlines()[1].startswith("changed,arm,right,")
    assert "2026-03-10" in page.read_text()


def test_a_list_gives_the_same_as_the_folders(runs):
    rows = "".join(
        f"{arm}/2026-03-{8 + k:02d},{arm},2026-03-{8 + k:02d}\n"
        for arm in ("left", "right")
        for k in range(5)
    )
    (runs / "list.csv").write_text(f"result,arm,time\n{rows}")
    assert fleet([runs / "list.csv"]).facts() == fleet(sorted(runs.glob("*/20*"))).facts()


def test_what_cannot_be_read_is_named_and_the_others_take_part(runs):
    damaged = runs / "left" / "2026-03-09" / "parameters.npz"
    damaged.write_bytes(damaged.read_bytes()[:500])
    found = fleet(sorted(runs.glob("*/*")))
    ((path, why),) = found.unread
    assert path == str(damaged)
    assert "parameters.npz" in why
    assert found.runs == 9
    with pytest.raises(NotAnArtifact, match="none of 1 results"):
        fleet([damaged])


@pytest.mark.parametrize("text", ["result,arm\na,b\n", "result,arm,time\na,b,\n"])
def test_a_list_without_a_column_is_refused_with_its_line(tmp_path, text):
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(
        WrongUsage, match=r"list\.csv:2: a list of results has the columns result, arm, time"
    ):
        fleet([tmp_path / "list.csv"])


def test_two_runs_of_an_arm_at_one_time_are_refused(runs):
    with pytest.raises(WrongUsage, match="at the same time"):
        fleet([runs / "left" / "2026-03-08", runs / "left" / "2026-03-08"])


def test_results_are_read_by_workers_as_they_are_by_one_process(runs, monkeypatch):
    from dynid.workflows import fleet as module

    monkeypatch.setattr(module, "AT_ONCE", 3)
    one = fleet(sorted(runs.glob("*/*")), FleetOptions(jobs=1)).facts()
    monkeypatch.setattr(module, "MANY", 1)
    assert fleet(sorted(runs.glob("*/*")), FleetOptions(jobs=2)).facts() == one


def test_the_page_needs_no_network_and_names_cannot_become_markup():
    rng = np.random.default_rng(0)
    value = 1 + 0.01 * rng.standard_normal((3, 8, 1))
    value[1, 4:] += 0.5
    t = np.tile(np.arange(8.0), (3, 1))
    names = ("a", "<script>alert(1)</script>", "c")
    found = look_at(History(names, ("fv<b>",), t, value, np.full(value.shape, 0.01)))
    page = fleet_page(
        "one of 3 arms changed", [("arm", found, {}, {"fv<b>": "N m"})], 24, [("x", "<i>")]
    )
    assert found.changes
    assert "<script" not in page
    assert "<b>" not in page
    assert "<i>" not in page
    assert not re.search(r"(?:src|href)=[\"'](?!#|data:)", page)
    assert not re.search("https?:", page)


@pytest.mark.parametrize("day", [-1e9, 0.5, 7304.0, 84_000.0, 1e8, 999_999_999.0])
def test_a_number_of_days_that_is_no_date_stays_a_number(day):
    assert _text_of(day) == f"{day:g}"


def test_a_number_of_days_is_the_date_that_it_came_from():
    for text in ("1990-01-01", "2026-02-28", "2199-12-01"):
        assert _text_of(_day(text)) == text
