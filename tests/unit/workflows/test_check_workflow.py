"""Checks of files return what was found, for programs that call them."""

from dataclasses import replace

import numpy as np
import pytest

from dynid import LogOptions
from dynid.errors import LogTooShort, NotFinite
from dynid.loading import checked_log
from dynid.workflows.files import check
from twolink import log


def test_columns_whose_names_say_nothing_are_asked_for(tmp_path):
    rows = "\n".join(f"{k / 100},{k / 1000},{k % 7}" for k in range(100))
    (tmp_path / "drive.csv").write_text(f"t,qm,vir\n{rows}\n")
    (found,) = check([tmp_path / "drive.csv"])
    assert [finding.code for finding in found.findings] == ["W330"]
    assert (
        'columns: {time: "t", position: "POSITION_{i}", effort: "TORQUE_{i}"}'
        in found.facts["snippet"]
    )


@pytest.mark.parametrize("exclude", ["1-2,3.0-4", ["1-2", "3-4"], ((1.0, 2.0), (3.0, 4.0))])
def test_intervals_are_excluded_alike_however_they_are_written(arm, exclude):
    tau = log(1).tau.copy()
    tau[(log(1).t > 1.5) & (log(1).t < 1.6) | (log(1).t > 3.5) & (log(1).t < 3.6)] = np.nan
    broken = replace(log(1), tau=tau)
    with pytest.raises(NotFinite):
        checked_log(broken, arm)
    clean = checked_log(broken, arm, LogOptions(exclude=exclude))
    assert np.isfinite(clean.tau).all()
    assert not np.any((clean.t > 1.01) & (clean.t < 1.99) | (clean.t > 3.01) & (clean.t < 3.99))


def test_what_was_noticed_in_a_log_is_said_before_it_is_refused(arm, monkeypatch):
    said = []
    monkeypatch.setattr("dynid.loading.notice", said.extend)
    with pytest.raises(LogTooShort):
        checked_log(replace(log(1), findings=("cut",)), arm, LogOptions(exclude="0.5-99"))
    assert said == ["cut"]
