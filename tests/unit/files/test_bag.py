"""Bags are read without ROS, with the numbers, names and stamps that were written; of damaged ones what is readable."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid.errors import BagTruncated
from dynid.files.bags import read_bag
from makelogs import START, joint_state, state_messages, write_bag

NAMES = ("shoulder", "elbow", "wrist")
TOPIC = "/joint_states"


def only_log(path):
    (log,) = read_bag(path).logs
    return log


@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
@pytest.mark.parametrize("chunk", [None, 2000])
def test_every_compression_and_chunk_size_gives_the_numbers_that_were_written(
    tmp_path, compression, chunk
):
    path = write_bag(tmp_path / "log.bag", state_messages(500, NAMES), compression, chunk)
    log = only_log(path)
    row = np.arange(500)[:, None] + np.arange(3) / 100
    assert (log.names, read_bag(path).findings) == (NAMES, ())
    assert_array_equal([log.q, log.qd, log.tau], [row, 10 * row, 100 * row])
    assert log.extra["clock"] == "header"
    assert log.extra["arrival_ns"] == (START, START + 499 * 10**7)
    assert_allclose(log.t, 0.01 * np.arange(500), atol=1e-12)


def test_columns_follow_their_names_when_order_and_layout_change_within_a_bag(tmp_path):
    messages = []
    for i in range(40):
        order, ns = [0, 1, 2] if i % 2 else [2, 0, 1], START + i * 10**7
        row, names = (i + np.arange(3) / 100)[order], [NAMES[k] for k in order]
        messages.append((TOPIC, ns, joint_state(ns, names, row, [], row, "x" * (i % 5))))
    log = only_log(write_bag(tmp_path / "log.bag", messages))
    columns = [log.names.index(name) for name in NAMES]
    assert_array_equal(log.q[:, columns], np.arange(40)[:, None] + np.arange(3) / 100)
    assert log.qd is None


@pytest.mark.parametrize("chunk", [None, 3000])
def test_topics_of_equal_message_length_that_take_turns_are_told_apart(tmp_path, chunk):
    """Also where one of them is missing now and then, and where headers are of another length than before."""
    some = [k for k in range(300) if k % 7]
    every = state_messages(300, ("a", "b"), "/other")
    other = [(topic, ns + 5, message) for topic, ns, message in (every[k] for k in some)]
    mine = state_messages(300, ("a", "b"), "/mine")
    messages = sorted(other + mine, key=lambda item: item[1])
    topics, logs, _ = read_bag(write_bag(tmp_path / "log.bag", messages, chunk=chunk))
    assert {*map(str, topics.values())} == {
        "/mine (JointState, 300)",
        f"/other (JointState, {len(some)})",
    }
    for log, rows in zip(logs, (np.arange(300), np.array(some)), strict=True):
        assert_array_equal(log.q[:, 1], rows + 0.01)


@pytest.mark.parametrize(
    ("header", "clock", "step"),
    [
        (lambda i: 5 * 10**9 + i * 11 * 10**6, "header", 0.011),
        (lambda i: 0, "arrival", 0.01),
        (lambda i: 7, "arrival", 0.01),
        (lambda i: START if i else 0, "arrival", 0.01),
    ],
    ids=["monotonic", "zero", "frozen", "partly"],
)
def test_header_stamps_are_used_as_they_tick_and_the_bags_clock_where_one_is_unset_or_frozen(
    tmp_path, header, clock, step
):
    log = only_log(write_bag(tmp_path / "log.bag", state_messages(50, NAMES, header=header)))
    assert log.extra["clock"] == clock
    assert_allclose(log.t, step * np.arange(50), atol=1e-12)


# ---------------------------------------------------------------- damaged ones
@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Ten thousand messages at 1 kHz, in chunks of 768 kB as a recorder writes them."""
    folder = tmp_path_factory.mktemp("bags")
    messages = state_messages(10_000, [f"joint_{i}" for i in range(1, 8)], TOPIC, 1000.0)
    return {
        c: write_bag(folder / f"{c}.bag", messages, c, chunk=768 * 1024).read_bytes()
        for c in ("none", "lz4", "bz2")
    }


def cut(share):
    return lambda content: content[: int(share * len(content))]


def without_index(content):
    index = int.from_bytes(content[content.index(b"index_pos=") + 10 :][:8], "little")
    return content[:index] + b"\xff" * (len(content) - index)


def with_a_hole(content):
    place = int(0.3 * len(content))
    return content[:place] + bytes(200) + content[place + 200 :]


@pytest.mark.parametrize(
    ("compression", "damage", "least", "most"),
    [
        # The last 1 % holds at least the index of 10000 messages (12 bytes each): nearly all messages are before it.
        ("none", cut(0.99), 9900, 10_000),
        ("none", without_index, 10_000, 10_000),
        ("lz4", cut(0.5), 2001, 6500),
        ("bz2", cut(0.5), 2001, 6500),
        ("lz4", with_a_hole, 6001, 10_000),
        ("bz2", with_a_hole, 6001, 10_000),
    ],
)
def test_a_damaged_bag_gives_what_is_readable_and_says_how_much(
    tmp_path, bags, compression, damage, least, most
):
    path = tmp_path / "log.bag"
    path.write_bytes(damage(bags[compression]))
    log, (finding,) = only_log(path), read_bag(path).findings
    assert least <= len(log) <= most
    assert set(np.unique(log.q[:, 1] - log.q[:, 0]).round(9)) == {0.01}
    if damage is not with_a_hole:
        assert_array_equal(log.q[:, 0], np.arange(len(log)))
        assert finding.evidence["seconds"] == pytest.approx((len(log) - 1) / 1000)
    assert finding.code == "W305"
    assert f"{len(log)} messages" in finding.text


def test_a_recorder_that_was_killed_before_closing_leaves_a_readable_bag(tmp_path):
    messages = state_messages(3000, NAMES)
    path = write_bag(tmp_path / "log.bag.active", messages, chunk=100_000, closing=False)
    assert len(only_log(path)) > 2500
    assert read_bag(path).findings[0].code == "W305"


@pytest.mark.parametrize(("size", "said"), [(0, "empty"), (4200, "ends early")])
def test_a_bag_without_one_readable_message_is_refused(tmp_path, bags, size, said):
    (tmp_path / "log.bag").write_bytes(bags["none"][:size])
    with pytest.raises(BagTruncated, match=said):
        read_bag(tmp_path / "log.bag")
