import pytest

import twolink


@pytest.fixture
def arm(dynid):
    """A folder with arm.yaml, log.csv and unseen.csv; identify writes no report, which is most of its time."""
    twolink.write_arm(dynid.folder)
    dynid.env["DYNID_IDENTIFY_REPORT"] = "no"
    return dynid
