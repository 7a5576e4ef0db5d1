"""What a notebook may hand over: numbers that no arm gives are errors of the catalogue, options of any kind are answered, names are text."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from inputs import ROBOT, motion

import dynid
from dynid.errors import DynidError, WrongUsage

LOG = motion(4)
#: Logs that no arm gives: time, positions, torques.
LOGS = {
    "no time": lambda t, q, tau: (np.full_like(t, np.nan), q, tau),
    "no positions": lambda t, q, tau: (t, q * np.nan, tau),
    "infinite torques": lambda t, q, tau: (t, q, tau * np.inf),
    "1e300": lambda t, q, tau: (t, q * 1e300, tau * 1e300),
    "1e-300": lambda t, q, tau: (t, q * 1e-300, tau * 1e-300),
    "whole numbers": lambda t, q, tau: (t, q.astype(int), tau.astype(int)),
    "complex": lambda t, q, tau: (t, q * 1j, tau),
    "objects": lambda t, q, tau: (t, q.astype(object), tau),
    "backwards": lambda t, q, tau: (t[::-1], q, tau),
    "one sample": lambda t, q, tau: (t[:1], q[:1], tau[:1]),
    "none": lambda t, q, tau: (t[:0], q[:0], tau[:0]),
    "ten joints": lambda t, q, tau: (t, np.tile(q, 5), np.tile(tau, 5)),
    "one dimension": lambda t, q, tau: (t, q[:, 0], tau[:, 0]),
    "three dimensions": lambda t, q, tau: (t, q[None], tau[None]),
    "text": lambda t, q, tau: (t, q.astype(str), tau),
    "dates": lambda t, q, tau: (np.arange(len(t)).astype("M8[s]"), q, tau),
}
VALUES = (
    None,
    float("nan"),
    float("inf"),
    "",
    "\0",
    b"x",
    [],
    {},
    (),
    object(),
    np.zeros(3),
    np.zeros((0, 2)),
    np.array(["a"]),
    10**400,
    "9" * 5000,
    len,
)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "arm.yaml"
    path.write_text(ROBOT)
    return dynid.load_robot(path)


@pytest.mark.parametrize("case", LOGS)
def test_a_log_that_no_arm_gives_is_an_error_of_the_catalogue(case, arm):
    with np.errstate(all="ignore"), pytest.raises(DynidError):
        dynid.identify(arm, [dynid.Log(*LOGS[case](LOG.t, LOG.q, LOG.tau))])


@pytest.mark.parametrize("logs", [[], (), {}, [None], np.zeros(3), b"log.npz"], ids=repr)
def test_what_is_no_log_is_told_what_would_be_one(logs, arm):
    with pytest.raises(WrongUsage, match=r"logs .*must be a log"):
        dynid.identify(arm, logs)


def asked_with(name: str, arm) -> list[str]:
    """Call a public function with each argument in turn as something else; return what is no error of the catalogue."""
    function = getattr(dynid, name)
    given = [
        each for each in inspect.signature(function).parameters.values() if each.kind not in (2, 4)
    ]
    usual = {
        each.name: LOG if each.name in ("log", "logs") else arm
        for each in given
        if each.default is each.empty
    }
    wrong = []
    for each in given:
        for value in VALUES if each.name not in ("progress", "write") else ():
            # Why not None: where it is the default, the call is right and takes its time.
            if value is None and each.default is None:
                continue
            try:
                function(**{**usual, each.name: value})
            except DynidError:
                continue
            except Exception as error:  # noqa: BLE001
                wrong.append(f"{each.name}={value!r:.20}: {type(error).__name__}: {error}")
    return wrong


@pytest.mark.parametrize(
    "name",
    [
        "base_model",
        "compare",
        "export",
        "find_drive_gains",
        "find_gap",
        "identify",
        "load",
        "load_log",
        "load_robot",
        "observe",
        "report",
        "simulate",
        "validate",
    ],
)
def test_an_argument_of_any_kind_is_an_error_of_the_catalogue(name, arm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with np.errstate(all="ignore"):
        assert asked_with(name, arm) == []


@pytest.mark.parametrize(
    "points",
    [
        np.zeros(3),
        np.zeros((2, 2, 2)),
        np.zeros((0, 2)),
        [[0, 0], [10**400, 0]],
        [[0], [1]],
        "x",
        [[0, np.nan], [1, 1]],
    ],
    ids=repr,
)
def test_waypoints_of_any_kind_are_taken_or_refused_in_a_sentence(points, arm):
    with pytest.raises(DynidError):
        dynid.plan_trajectory(arm, waypoints=points)


@pytest.mark.parametrize("name", ["cutoff", "method", "holdout", "delay", "exclude"])
def test_an_option_of_any_kind_is_taken_or_refused_in_a_sentence(name):
    refused = []
    for value in VALUES:
        try:
            dynid.IdentifyOptions(**{name: value})
        except WrongUsage as mistake:
            refused.append(mistake.what)
    assert refused
    assert all(what.startswith(f"--{name}") for what in refused)


def test_names_are_text_in_a_notebook():
    name = "<script>alert(1)</script>\x1b[31m\u202e"
    html = dynid.Log(LOG.t, LOG.q, LOG.tau, (name, "elbow"))._repr_html_()
    assert "<script" not in html
    assert html.isprintable()
