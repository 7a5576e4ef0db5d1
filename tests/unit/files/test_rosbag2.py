"""The same joint states give the same log, whatever they were recorded in; damaged recordings give what is readable."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid.errors import BagTruncated, DynidError
from dynid.files.logs import read_log
from dynid.signals.columns import take_samples
from makelogs import lwr, lwr_log
from recordings import (
    of_ros2,
    single,
    write_bag,
    write_mcap,
    write_rosbag2,
    write_text,
)

TOPIC = "/lwr/joint_states"
FORMATS = {
    "rosbag2 with SQLite": lambda log, at: write_rosbag2(at / "bag", of_ros2(log, TOPIC)),
    "rosbag2 with MCAP": lambda log, at: write_rosbag2(at / "bag", of_ros2(log, TOPIC), "mcap"),
    "packed MCAP": lambda log, at: write_rosbag2(
        at / "bag", of_ros2(log, TOPIC), "mcap", compress="storage"
    ),
    "single .db3": lambda log, at: single(
        write_rosbag2(at / "bag", of_ros2(log, TOPIC)), at / "one.db3"
    ),
    "MCAP, zstd": lambda log, at: write_mcap(at / "a.mcap", of_ros2(log, TOPIC), "zstd"),
    "MCAP, lz4": lambda log, at: write_mcap(at / "a.mcap", of_ros2(log, TOPIC), "lz4"),
    "MCAP": lambda log, at: write_mcap(at / "a.mcap", of_ros2(log, TOPIC)),
    "ROS 1 bag": lambda log, at: write_bag(at / "a.bag", log, TOPIC),
    "CSV": lambda log, at: write_text(at / "a.csv", log),
    "CSV, header in a comment, ns": lambda log, at: write_text(
        at / "a.csv", log, ",", False, "# ", unit=1e9
    ),
    "TSV": lambda log, at: write_text(at / "a.tsv", log, "\t", True),
    "npz": lambda log, at: log.save(at / "a.npz"),
}


@pytest.fixture(scope="module")
def log():
    some = take_samples(lwr_log(), np.arange(600))
    return replace(some, t=np.arange(600) * 0.005, qd=None, findings=(), extra={})


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_the_same_numbers(kind, log, tmp_path):
    found = read_log(FORMATS[kind](log, tmp_path), robot=lwr())
    assert_allclose(found.t, log.t, rtol=0, atol=1e-15)
    assert_array_equal(found.q, log.q)
    assert_array_equal(found.tau, log.tau)
    assert set(lwr().log_names) <= set(found.names)
    assert len(found.sha256) == 64


@pytest.mark.parametrize("kind", ["single .db3", "MCAP"])
def test_a_cut_recording_of_ros2_says_how_to_recover_it(kind, log, tmp_path):
    path = FORMATS[kind](log, tmp_path)
    path.write_bytes(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    with pytest.raises(BagTruncated, match="ends early") as caught:
        read_log(path, robot=lwr())
    assert "recover" in caught.value.fix


def test_messages_that_wait_in_a_journal_are_not_left_out_silently(log, tmp_path):
    path = FORMATS["single .db3"](log, tmp_path)
    path.with_name("one.db3-wal").write_bytes(b"messages")
    with pytest.raises(BagTruncated, match=r"one\.db3-wal"):
        read_log(path, robot=lwr())


def test_a_folder_without_metadata_or_with_a_wrong_one_is_read_by_its_files(log, tmp_path):
    bag = FORMATS["rosbag2 with SQLite"](log, tmp_path)
    for text in (
        None,
        "",
        "{",
        "rosbag2_bagfile_information: {relative_file_paths: [gone.db3], version: 5}",
    ):
        (bag / "metadata.yaml").unlink(missing_ok=True)
        if text is not None:
            (bag / "metadata.yaml").write_text(text)
        assert_array_equal(read_log(bag, robot=lwr()).q, log.q)


@pytest.mark.parametrize("store", ["sqlite3", "mcap"])
def test_a_recording_that_was_split_is_read_in_the_order_of_its_parts(store, log, tmp_path):
    """The recorder begins a new file every so many bytes; the eleventh follows the tenth, not the first."""
    suffix = ".mcap" if store == "mcap" else ".db3"
    (tmp_path / "bag").mkdir()
    for k in range(12):
        part = take_samples(log, np.arange(50 * k, 50 * k + 50))
        one = write_rosbag2(tmp_path / f"part{k}", of_ros2(part, TOPIC), store)
        next(one.glob(f"*{suffix}")).rename(tmp_path / "bag" / f"drive_{k}{suffix}")
    found = read_log(tmp_path / "bag", robot=lwr())
    assert_allclose(found.t, log.t, rtol=0, atol=1e-15)
    assert_array_equal(found.tau, log.tau)


def test_a_folder_whose_files_are_gone_is_an_error(log, tmp_path):
    bag = FORMATS["rosbag2 with SQLite"](log, tmp_path)
    for part in bag.glob("*.db3"):
        part.unlink()
    with pytest.raises(DynidError, match=r"no \.db3 or \.mcap file"):
        read_log(bag, robot=lwr())
