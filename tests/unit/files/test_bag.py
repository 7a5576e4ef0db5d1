"""Bags are read and written without ROS, with the numbers, names and stamps that were written."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid.errors import BagTruncated
from dynid.files.bags import list_topics, read_topics
from makelogs import START, joint_state, state_messages, write_bag

NAMES = ("shoulder", "elbow", "wrist")


@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
@pytest.mark.parametrize("chunk", [None, 2000])
def test_every_compression_and_chunk_size_gives_the_numbers_that_were_written(
    tmp_path, compression, chunk
):
    path = write_bag(tmp_path / "log.bag", state_messages(500, NAMES), compression, chunk)
    groups, findings = read_topics(path, ["/joint_states"])
    (log,) = groups["/joint_states"]
    row = np.arange(500)[:, None] + np.arange(3) / 100
    assert log.names == NAMES
    assert findings == ()
    assert_array_equal(log.q, row)
    assert_array_equal(log.qd, 10 * row)
    assert_array_equal(log.tau, 100 * row)
    assert (log.extra["clock"], log.extra["absent"]) == ("header", ())
    assert log.extra["arrival_ns"] == (START, START + 499 * 10**7)
    assert_allclose(log.t, 0.01 * np.arange(500), atol=1e-12)


def test_columns_follow_their_names_when_order_and_layout_change_within_a_bag(tmp_path):
    messages = []
    for i in range(40):
        order = [0, 1, 2] if i % 2 else [2, 0, 1]
        row = i + np.arange(3) / 100
        names = [NAMES[k] for k in order]
        messages.append(
            (
                "/joint_states",
                START + i * 10**7,
                joint_state(START + i * 10**7, names, row[order], [], row[order], "x" * (i % 5)),
            )
        )
    groups, _ = read_topics(write_bag(tmp_path / "log.bag", messages), ["/joint_states"])
    (log,) = groups["/joint_states"]
    columns = [log.names.index(name) for name in NAMES]
    assert_array_equal(log.q[:, columns], np.arange(40)[:, None] + np.arange(3) / 100)
    assert (log.qd, log.extra["absent"]) == (None, ("velocity",))


def test_topics_of_equal_message_length_that_take_turns_are_told_apart(tmp_path):
    """Also where one of them is missing now and then, and where headers are of another length than before."""
    other = [
        (t, ns + 5, m)
        for k, (t, ns, m) in enumerate(state_messages(300, ("a", "b"), "/other"))
        if k % 7
    ]
    mine = state_messages(300, ("a", "b"), "/mine")
    messages = sorted(other + mine, key=lambda item: item[1])
    for chunk in (None, 3000):
        groups, _ = read_topics(
            write_bag(tmp_path / f"{chunk}.bag", messages, chunk=chunk), ["/mine", "/other"]
        )
        for name, rows in (("/mine", np.arange(300)), ("/other", [k for k in range(300) if k % 7])):
            assert_array_equal(groups[name][0].q[:, 1], np.array(rows) + 0.01)


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
    path = write_bag(tmp_path / "log.bag", state_messages(50, NAMES, header=header))
    (log,) = read_topics(path, ["/joint_states"])[0]["/joint_states"]
    assert log.extra["clock"] == clock
    assert_allclose(log.t, step * np.arange(50), atol=1e-12)


def test_topics_are_listed_with_type_and_count(tmp_path):
    path = write_bag(
        tmp_path / "log.bag", state_messages(7, NAMES, "/a") + state_messages(9, NAMES, "/b")
    )
    assert {str(topic) for topic in list_topics(path).values()} == {
        "/a (JointState, 7)",
        "/b (JointState, 9)",
    }


def test_an_empty_bag_file_says_that_nothing_was_recorded(tmp_path):
    (tmp_path / "log.bag").write_bytes(b"")
    with pytest.raises(BagTruncated, match="empty"):
        list_topics(tmp_path / "log.bag")
