"""A damaged bag gives back what is readable, and says how much that is."""

import numpy as np
import pytest

from dynid.errors import BagTruncated
from dynid.files.bags import list_topics, read_topics
from makelogs import state_messages, write_bag

NAMES = tuple(f"joint_{i}" for i in range(1, 8))
TOPIC = "/joint_states"


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Ten thousand messages at 1 kHz, in chunks of 768 kB as a recorder writes them."""
    folder = tmp_path_factory.mktemp("bags")
    messages = state_messages(10_000, NAMES, TOPIC, 1000.0)
    return {
        c: write_bag(folder / f"{c}.bag", messages, c, chunk=768 * 1024).read_bytes()
        for c in ("none", "lz4", "bz2")
    }


def read(path):
    groups, findings = read_topics(path, [TOPIC])
    return groups[TOPIC][0], findings


def test_a_bag_cut_at_99_percent_gives_all_messages_before_the_cut(tmp_path, bags):
    path = tmp_path / "cut.bag"
    path.write_bytes(bags["none"][: int(0.99 * len(bags["none"]))])
    log, (finding,) = read(path)
    # The last 1 % holds at least the index of 10000 messages (12 bytes each), so nearly all messages are before it.
    assert 9900 <= len(log) <= 10_000
    np.testing.assert_array_equal(log.q[:, 0], np.arange(len(log)))
    assert finding.code == "W305"
    assert f"{len(log)} messages" in finding.text
    assert finding.evidence["seconds"] == pytest.approx((len(log) - 1) / 1000)


def test_a_bag_whose_index_is_destroyed_gives_every_message(tmp_path, bags):
    content = bytearray(bags["none"])
    index = int.from_bytes(content[content.index(b"index_pos=") + 10 :][:8], "little")
    content[index:] = b"\xff" * (len(content) - index)
    (tmp_path / "log.bag").write_bytes(content)
    log, findings = read(tmp_path / "log.bag")
    assert len(log) == 10_000
    assert [f.code for f in findings] == ["W305"]


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_a_compressed_bag_cut_in_the_middle_gives_its_whole_chunks(tmp_path, bags, compression):
    (tmp_path / "log.bag").write_bytes(bags[compression][: len(bags[compression]) // 2])
    log, _ = read(tmp_path / "log.bag")
    assert 2000 < len(log) <= 6500
    np.testing.assert_array_equal(log.q[:, 0], np.arange(len(log)))


def test_a_recorder_that_was_killed_before_closing_leaves_a_readable_bag(tmp_path):
    path = write_bag(
        tmp_path / "log.bag.active", state_messages(3000, NAMES), chunk=100_000, closing=False
    )
    log, findings = read(path)
    assert len(log) > 2500
    assert findings[0].code == "W305"


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_bytes_destroyed_in_one_compressed_chunk_cost_that_chunk_only(tmp_path, bags, compression):
    content = bytearray(bags[compression])
    middle = len(content) // 2
    content[middle : middle + 200] = bytes(200)
    (tmp_path / "log.bag").write_bytes(content)
    log, _ = read(tmp_path / "log.bag")
    assert 6000 < len(log) <= 10_000
    assert set(np.unique(log.q[:, 1] - log.q[:, 0]).round(9)) == {0.01}


def test_topics_of_a_cut_bag_are_still_listed(tmp_path, bags):
    (tmp_path / "log.bag").write_bytes(bags["none"][: len(bags["none"]) // 3])
    assert list_topics(tmp_path / "log.bag")[TOPIC].type == "sensor_msgs/JointState"


def test_a_bag_with_nothing_readable_is_refused(tmp_path, bags):
    (tmp_path / "log.bag").write_bytes(bags["none"][:5000][:4200])
    with pytest.raises(BagTruncated, match="ends early"):
        list_topics(tmp_path / "log.bag")
