"""Long arrays live in files without a name: what was put in comes out, and memory holds a piece of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dynid import scratch


def test_rows_come_back_as_they_were_added_whether_they_fit_into_memory_or_not(monkeypatch):
    rows = np.random.default_rng(0).standard_normal((5000, 3))
    for size in (scratch.IN_MEMORY, 1000):
        monkeypatch.setattr(scratch, "IN_MEMORY", size)
        growing = scratch.Growing(3)
        for start in range(0, 5000, 700):
            growing.append(rows[start : start + 700])
        np.testing.assert_array_equal(growing.whole(), rows)
        np.testing.assert_array_equal(
            scratch.taken(growing.whole(), np.arange(4999, 0, -3)), rows[4999:0:-3]
        )


def test_released_pages_keep_what_was_written(monkeypatch):
    monkeypatch.setattr(scratch, "IN_MEMORY", 1000)
    array = scratch.empty((4000, 2))
    array[:] = 7.0
    scratch.release()
    assert np.all(array == 7.0)


def test_a_gigabyte_is_written_and_read_in_a_tenth_of_the_memory():
    code = """
import resource
import numpy as np
import pytest
from dynid.scratch import PIECE, Growing, release
growing, block, total = Growing(8), np.ones((PIECE, 8)), 0.0
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for _ in range(256):
    growing.append(block)
whole = growing.whole()
for start in range(0, len(whole), PIECE):
    total += whole[start : start + PIECE].sum()
    release()
print(total == 256 * PIECE * 8, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    right, more = done.stdout.split()
    assert right == "True"
    assert int(more) < 100_000


def test_other_numbers_become_floats_piece_by_piece(monkeypatch):
    monkeypatch.setattr(scratch, "IN_MEMORY", 1000)
    monkeypatch.setattr(scratch, "PIECE", 300)
    for array in (
        np.arange(3000, dtype=np.int32).reshape(1000, 3),
        np.linspace(0, 1, 2000).astype(">f8"),
    ):
        found = scratch.floats(array)
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, array.astype(float))
    same = np.zeros(5000)
    assert scratch.floats(same) is same


def test_parts_are_joined_in_a_file_and_a_single_one_is_itself(monkeypatch):
    monkeypatch.setattr(scratch, "IN_MEMORY", 1000)
    parts = [np.arange(k, k + 600.0).reshape(-1, 2) for k in (0, 600)]
    np.testing.assert_array_equal(scratch.joined(parts), np.concatenate(parts))
    assert scratch.joined(parts[:1]) is parts[0]


@pytest.mark.parametrize("count", [1, 2, 7, 8])
@pytest.mark.parametrize("axis", [None, 0, 1])
def test_the_median_is_that_of_numpy(count, axis):
    x = np.random.default_rng(count).standard_normal((count, count + 1))
    np.testing.assert_array_equal(scratch.median(x, axis), np.median(x, axis))
    x[0, 0] = np.nan
    np.testing.assert_array_equal(scratch.median(x, axis), np.median(x, axis))


def test_nothing_has_no_median():
    assert np.isnan(scratch.median(np.zeros(0)))
    np.testing.assert_array_equal(scratch.median(np.zeros((0, 2)), 0), [np.nan, np.nan])


def test_a_log_is_checked_without_masked_arrays():
    """Their import takes as long as the bodies that a whole log is fitted with."""
    code = """
import sys
import dynid, numpy, scipy.special  # the correction for short logs needs it, and it imports them by itself
arm = dynid.load_robot("kuka_lwr4plus")
base = dynid.base_model(arm)  # its derivation may take as long as it likes
for name in ("numpy.ma", "numpy.ma.core", "numpy.ma.extras"):
    sys.modules.pop(name, None)
vars(numpy).pop("ma", None)
dynid.identify(arm, dynid.load_log(sys.argv[1], arm), base=base)
print("numpy.ma" in sys.modules)
"""
    log = Path(__file__).parents[2] / "trajectories" / "lwr4plus_validate.bag"
    done = subprocess.run(
        [sys.executable, "-c", code, str(log)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"
