"""The table of limits: what is beyond a line of it is refused before it is taken into memory."""

import io
import os
import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from dynid import limits
from dynid.errors import TooLarge
from dynid.files.robotfile import parse_robot
from dynid.model.program import Program
from dynid.model.reduce import reduce_plain
from dynid.model.regressor import Model
from dynid.trajectory.basis import Quintic
from dynid.trajectory.plan import Trajectory

ARM = "name: arm\nconvention: standard\njoints: [{a: 0.3}, {a: 0.2}, {a: 0.1}, {a: 0.1}]\n"

every = pytest.mark.parametrize("name", limits.LIMITS)


@every
def test_what_is_at_a_limit_passes_and_what_is_beyond_says_how_to_raise_it(name):
    most = limits.LIMITS[name].most
    limits.check(name, most, "x.bag")
    with pytest.raises(TooLarge) as told:
        limits.check(name, most + 1, "x.bag")
    assert "x.bag" in told.value.what
    raised, value = limits.read_limits(re.search(r"--limit (\S+)", told.value.fix)[1])
    assert raised == name
    with limits.raised({raised: value}):
        limits.check(name, most + 1, "x.bag")


@pytest.mark.parametrize("size", [float("inf"), float("nan"), 1e18])
def test_what_is_endless_is_refused_and_no_limit_is_said_to_be_raised_for_it(size):
    with pytest.raises(TooLarge) as told:
        limits.check("samples", size, "the motion")
    assert "--limit" not in told.value.fix


def test_raised_limits_hold_in_their_block_also_inside_each_other_and_after_an_error():
    with limits.raised({"joints": 40}):
        with suppress(KeyError), limits.raised({"samples": 5}):
            assert (limits.limit("joints"), limits.limit("samples")) == (40, 5)
            raise KeyError
        assert limits.limit("samples") == limits.LIMITS["samples"].most
        assert limits.words() == ["--limit", "joints=40"]
    assert limits.limit("joints") == limits.LIMITS["joints"].most


@pytest.mark.parametrize(
    "text",
    [
        "joints",
        "joints=1e18",
        "joints=",
        "joints=-1",
        "joints=0",
        "joints=nan",
        "joints=inf",
        "joints=1e999",
        "=5",
        "x=5",
        "joints=1_0",
        "joints=²",
        "joints=0x10",
        "joints= 5",
        "joints=" + "9" * 5000,
    ],
)
def test_what_is_no_limit_is_refused(text):
    with pytest.raises(ValueError, match=r"no limit|not a positive number"):
        limits.read_limits(text)


def test_a_small_file_may_expand_as_it_likes_and_a_large_one_may_not():
    limits.check_expansion(1, 16 << 20, "a")
    limits.check_expansion(1 << 20, 200 << 20, "a")
    with pytest.raises(TooLarge, match="times"):
        limits.check_expansion(1 << 20, 201 << 20, "a")
    with pytest.raises(TooLarge):
        limits.check_expansion(0, 17 << 20, "a")


def test_only_regular_files_are_opened(tmp_path):
    (tmp_path / "file").write_bytes(b"x" * 10)
    (tmp_path / "link").symlink_to(tmp_path / "file")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "zero").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    assert limits.read_bytes(tmp_path / "link", "yaml_bytes") == b"x" * 10
    for name in ("loop", "zero", "pipe", ".", "missing"):
        with pytest.raises(OSError):
            limits.open_file(tmp_path / name)


def test_a_file_is_measured_before_it_is_read(tmp_path):
    with (tmp_path / "sparse").open("wb") as stream:
        stream.truncate(1 << 40)
    with pytest.raises(TooLarge, match="1 099 511 627 776 bytes"):
        limits.read_bytes(tmp_path / "sparse", "yaml_bytes")


def test_a_file_that_has_nothing_to_read_yet_is_a_mistake_and_not_none():
    ours, theirs = os.pipe()
    os.set_blocking(ours, False)
    with io.BufferedReader(limits._File(ours, "kmsg")) as stream:
        os.write(theirs, b"abc")
        assert stream.read(3) == b"abc"
        for read in (stream.read, lambda: stream.read(5), stream.readline):
            with pytest.raises(OSError, match="nothing to read") as told:
                read()
            assert told.value.filename == "kmsg"
    os.close(theirs)


def test_what_a_command_asks_for_is_bounded_by_the_product_of_its_numbers():
    """Each number is possible for itself: an hour, a millisecond, a slow run; a hundred thousand states; a second."""
    robot = parse_robot(ARM, Path("arm.yaml"))
    none = np.zeros(0, dtype=np.int32)
    model = Model(
        robot, Program((), (), none, none, none, none, none, none, (robot.n, 11 * robot.n))
    )
    slow = Trajectory(Quintic((0.0, 3600.0)), np.zeros((2, 2)), alpha=0.1)
    with pytest.raises(TooLarge, match="a planned motion"):
        slow.sampled(1000.0)
    with pytest.raises(TooLarge, match="a regressor"):
        reduce_plain(model, samples=100_000)
