"""dynid as a library: what a notebook calls, without the command line and without files where there are arrays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.table import Table

ROOT = Path(__file__).parents[2]
LOGS = ROOT / "trajectories"


@pytest.fixture(scope="module")
def arm():
    return dynid.load_robot("kuka_lwr4plus")


@pytest.fixture(scope="module")
def result(story):
    return dynid.load(story.folder / "out/arm")


@pytest.fixture(scope="module")
def checked(arm, result):
    """Another motion of the arm."""
    return dynid.validate(result, dynid.load_log(LOGS / "lwr4plus_validate.bag", arm))


def test_every_public_name_is_there_and_documented():
    for name in set(dynid.__all__) - {"__version__"}:
        assert getattr(dynid, name).__doc__, name
    assert set(dynid.__all__) <= set(dir(dynid))


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="identifi"):
        dynid.identifi  # noqa: B018


@pytest.mark.slow
def test_arrays_give_the_parameters_of_the_file(arm, result):
    """The log's arrays are DH quantities here because the driver map of this arm is the identity."""
    log = dynid.load_log(LOGS / "lwr4plus_identify.bag", arm)
    again = dynid.identify(
        arm, dynid.Log(t=log.t, q=log.q, tau=log.tau, qd=log.qd, names=arm.joint_names)
    )
    assert np.array_equal(again.theta, result.theta)


def test_mistakes_are_exceptions_of_the_catalogue():
    with pytest.raises(dynid.errors.WrongUsage, match="cutoff"):
        dynid.IdentifyOptions(cutoff=-1.0)


def test_a_validation_shows_a_table_and_a_residual(arm, checked):
    assert checked.relative_error_percent < 0.5
    assert [row["joint"] for row in checked.table()] == list(arm.joint_names)
    assert ["joint", "rms", "error"] in [line.split()[:3] for line in repr(checked).splitlines()]
    assert checked._repr_html_().count("<tr>") == 1 + arm.n
    drawn = checked.plot_residual(7).axes[0].lines[0].get_ydata()
    rms = np.sqrt(np.nanmean(drawn**2))
    assert rms == pytest.approx(checked.joints[6].rms, rel=0.02)
    with pytest.raises(dynid.errors.WrongUsage, match="joint '8'"):
        checked.plot_residual(8)


def test_names_from_files_stay_text_in_tables():
    shown = Table([{"joint": "<b>x\x1b[31m", "value": 1.0}])
    assert "<b>" not in shown._repr_html_()
    assert "\x1b" not in repr(shown)


def test_two_logs_of_one_name_get_folders_of_their_own(checked, tmp_path):
    first = checked.folder(tmp_path)
    checked.save(first)
    other = replace(checked, log_sha256="0123456789abcdef")
    assert checked.folder(tmp_path) == first == tmp_path / "lwr4plus_validate"
    assert other.folder(tmp_path) == tmp_path / "lwr4plus_validate_01234567"
