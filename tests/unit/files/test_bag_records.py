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
    groups, (finding,) = read_topics(path, [TOPIC])
    (log,) = groups[TOPIC]
    assert least <= len(log) <= most
    assert set(np.unique(log.q[:, 1] - log.q[:, 0]).round(9)) == {0.01}
    if damage is not with_a_hole:
        np.testing.assert_array_equal(log.q[:, 0], np.arange(len(log)))
        assert finding.evidence["seconds"] == pytest.approx((len(log) - 1) / 1000)
    assert finding.code == "W305"
    assert f"{len(log)} messages" in finding.text


def test_a_recorder_that_was_killed_before_closing_leaves_a_readable_bag(tmp_path):
    path = write_bag(
        tmp_path / "log.bag.active", state_messages(3000, NAMES), chunk=100_000, closing=False
    )
    groups, findings = read_topics(path, [TOPIC])
    assert len(groups[TOPIC][0]) > 2500
    assert findings[0].code == "W305"


def test_topics_of_a_cut_bag_are_listed_as_long_as_anything_is_readable(tmp_path, bags):
    (tmp_path / "log.bag").write_bytes(cut(1 / 3)(bags["none"]))
    assert list_topics(tmp_path / "log.bag")[TOPIC].type == "sensor_msgs/JointState"
    (tmp_path / "log.bag").write_bytes(bags["none"][:4200])
    with pytest.raises(BagTruncated, match="ends early"):
        list_topics(tmp_path / "log.bag")
