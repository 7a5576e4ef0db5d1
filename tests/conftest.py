"""What all tests share: the recordings beside the project, and no silent skips in continuous integration."""

import os
import signal
from pathlib import Path

import pytest

from runner import Runner

# Before NumPy is loaded, as the command does: with two workers on two cores, threads of linear algebra wait for each
# other in loops that take five times the work itself.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ROOT = Path(__file__).parents[1]
#: Recordings of real arms, beside the project; tests that use them carry the mark ``data``.
RECORDINGS = ROOT.parent / "shared" / "data"

# A job in the background of a shell ignores Ctrl-C, and so would every program that is started here to be interrupted.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def recordings():
    """The folder of recordings of real arms."""
    if not RECORDINGS.is_dir():
        pytest.skip("the recordings (../shared/data) are not here")
    return RECORDINGS


@pytest.fixture(scope="session")
def workshop(tmp_path_factory):
    """Makes the command line in a folder of its own that several tests share."""

    def make():
        folder = tmp_path_factory.mktemp("workshop")
        return Runner(folder / "work", folder / "home")

    return make


@pytest.fixture
def dynid(tmp_path):
    """The command line in processes of its own, with an empty home and folder."""
    return Runner(tmp_path / "work", tmp_path / "home")


@pytest.fixture(scope="session")
def story(workshop):
    """The shipped log of the LWR4+ identified, with its report, in ``out/arm``: a folder that tests only add to."""
    run = workshop()
    bag = ROOT / "trajectories" / "lwr4plus_identify.bag"
    run.answer = run(f"identify kuka_lwr4plus {bag} -o out/arm --json").facts
    return run


def _unskipped(report):
    """Turn a skip into a failure: in continuous integration everything must really run."""
    if os.environ.get("CI") == "true" and report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome, report.longrepr = "failed", f"with CI=true nothing may be skipped: {reason}"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    return report if item.get_closest_marker("optional") else _unskipped(report)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    return _unskipped((yield))
