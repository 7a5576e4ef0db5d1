"""What a notebook may give to each public function, and what it hears when it gives something else."""

import copy
import inspect
import pickle
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import dynid
import twolink
from dynid.errors import DynidError, WrongUsage
from dynid.table import Table

OPTIONS = [name for name in dynid.__all__ if name.endswith("Options")]
#: Search that is over at once.
QUICK = {"duration": 10.0, "segments": 5, "optimise": False, "floor": None}


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """An arm, logs, a result, a motion and a gap search: as objects, and as files."""
    folder = tmp_path_factory.mktemp("api")
    twolink.write_arm(folder)
    twolink.write_log(folder / "third.csv", seed=3)
    from dynid.workflows.identify import save_result

    arm = dynid.load_robot(folder / "arm.yaml")
    log, unseen = (dynid.load_log(folder / name, arm) for name in ("log.csv", "unseen.csv"))
    result = dynid.identify(arm, log)
    save_result(folder / "out", result)
    gap = dynid.find_gap(result, unseen, effects="spring")
    gap.save(folder / "gap.npz")
    t, q, qd, qdd = twolink.motion(1)
    plan = dynid.plan_trajectory(arm, **QUICK)
    plan.save(folder / "trajectory.npz")
    return SimpleNamespace(
        folder=folder,
        arm=arm,
        log=log,
        unseen=unseen,
        result=dynid.load(folder / "out"),
        new=result,
        gap=gap,
        plan=plan,
        motion=dynid.Motion(t, q, qd, qdd),
        base=dynid.base_model(arm),
        observations=dynid.observe(arm, log),
    )


def right(here, name):
    """A call of a public function that is right."""
    return {
        "compare": {"results": [here.result]},
        "export": {"result": here.result, "path": here.folder / "arm.xml"},
        "find_payload": {"loaded": here.result, "unloaded": here.result},
        "identify": {"robot": here.arm, "logs": here.log},
        "report": {"result": here.result},
        "simulate": {"robot": here.arm, "motion": here.motion},
        "validate": {"result": here.result, "log": here.unseen},
    }[name]


PATHS = [
    ("identify", "robot", "arm.yaml"),
    ("identify", "logs", "third.csv"),
    ("validate", "log", "unseen.csv"),
    ("report", "result", "out"),
    ("export", "result", "out/parameters.npz"),
    ("compare", "results", "out"),
    ("find_payload", "loaded", "out"),
    ("simulate", "motion", "trajectory.npz"),
]


@pytest.mark.parametrize(("name", "parameter", "path"), PATHS)
def test_paths_stand_for_objects(here, name, parameter, path):
    for value in (here.folder / path, str(here.folder / path)):
        assert getattr(dynid, name)(**right(here, name) | {parameter: value}) is not None


@pytest.mark.parametrize(("name", "parameter", "_"), PATHS)
def test_a_wrong_argument_is_answered_by_a_sentence_that_names_it(here, name, parameter, _):
    for value in (np.zeros((3, 5, 2)), object(), b"bytes", [object()], None):
        with pytest.raises(WrongUsage, match=parameter):
            getattr(dynid, name)(**right(here, name) | {parameter: value})


def test_nothing_at_all_is_refused(here):
    with pytest.raises(WrongUsage, match="results is empty"):
        dynid.compare([])
    with pytest.raises(WrongUsage, match="logs is empty"):
        dynid.identify(here.arm, [])


def test_a_misspelt_word_is_told_its_neighbour(here):
    with pytest.raises(WrongUsage, match="did you mean 'cutoff'"):
        dynid.identify(here.arm, here.log, cutof=5)
    with pytest.raises(WrongUsage, match="did you mean 'progress'"):
        dynid.report(here.result, progres=None)


def test_options_are_keywords_or_an_object_or_both(here):
    words = {"method": "ols", "holdout": "30%", "cutoff": 5}
    assert words.keys() <= inspect.signature(dynid.identify).parameters.keys()
    by_words = dynid.identify(here.arm, here.log, **words)
    by_object = dynid.identify(here.arm, here.log, dynid.IdentifyOptions(**words))
    kept = dynid.IdentifyOptions(method="wls", holdout=0.3)
    by_both = dynid.identify(here.arm, here.log, kept, method="ols", cutoff=5.0)
    assert by_words.cutoff == 5
    for other in (by_object, by_both):
        assert np.array_equal(other.theta, by_words.theta)
    with pytest.raises(WrongUsage, match=r"options must be dynid.ValidateOptions"):
        dynid.validate(here.result, here.unseen, dynid.GapOptions())


@pytest.mark.parametrize("name", OPTIONS)
def test_every_option_refuses_what_it_cannot_be_when_the_object_is_made(name):
    kind = getattr(dynid, name)
    for option in inspect.signature(kind).parameters:
        for value in (object(), np.zeros((2, 3, 2)), 3j, [object()], b"bytes"):
            with pytest.raises(WrongUsage):
                kind(**{option: value})


THINGS = ["arm", "base", "log", "observations", "new", "result", "gap", "plan", "motion"]


@pytest.mark.parametrize("what", [*THINGS, "validation", "report", "simulation", "exported"])
def test_what_functions_return_pickles_copies_and_prints_quietly(here, what):
    make = {
        "validation": lambda: dynid.validate(here.result, here.unseen),
        "report": lambda: dynid.report(here.result),
        "simulation": lambda: dynid.simulate(here.arm, here.motion),
        "exported": lambda: dynid.export(here.result, here.folder / "arm.py"),
    }
    thing = make[what]() if what in make else getattr(here, what)
    for twin in (pickle.loads(pickle.dumps(thing)), copy.copy(thing), copy.deepcopy(thing)):
        assert type(twin) is type(thing)
        assert repr(twin) == repr(thing)
    assert len(repr(thing)) < 3000
    assert " object at 0x" not in repr(thing)


def test_a_motion_has_one_shape():
    t, q = np.arange(4.0), np.zeros((4, 2))
    with pytest.raises(DynidError, match="qdd"):
        dynid.Motion(t, q, q, None)
    with pytest.raises(DynidError, match="qd"):
        dynid.Motion(t, q, q[:3], q)


# ---------------------------------------------------------------- dynid as a library
ROOT = Path(__file__).parents[2]
LOGS = ROOT / "trajectories"


@pytest.fixture(scope="module")
def arm():
    return dynid.load_robot("kuka_lwr4plus")


@pytest.fixture(scope="module")
def result(story):
    return dynid.load(story.folder / "out/arm")


@pytest.fixture(scope="module")
def checked(arm, result):
    """Another motion of the arm."""
    return dynid.validate(result, dynid.load_log(LOGS / "lwr4plus_validate.bag", arm))


def test_every_public_name_is_there_and_documented():
    for name in set(dynid.__all__) - {"__version__"}:
        assert getattr(dynid, name).__doc__, name
    assert set(dynid.__all__) <= set(dir(dynid))


def test_mistakes_are_exceptions_of_the_catalogue():
    with pytest.raises(dynid.errors.WrongUsage, match="cutoff"):
        dynid.IdentifyOptions(cutoff=-1.0)


@pytest.mark.slow
def test_arrays_give_the_parameters_of_the_file(arm, result):
    """The log's arrays are DH quantities here because the driver map of this arm is the identity."""
    log = dynid.load_log(LOGS / "lwr4plus_identify.bag", arm)
    again = dynid.identify(
        arm, dynid.Log(t=log.t, q=log.q, tau=log.tau, qd=log.qd, names=arm.joint_names)
    )
    assert abs(again.theta - result.theta).max() < 1e-12


def test_a_validation_shows_a_table_and_a_residual(arm, checked):
    assert checked.relative_error_percent < 0.5
    assert [row["joint"] for row in checked.table()] == list(arm.joint_names)
    assert ["joint", "rms", "error"] in [line.split()[:3] for line in repr(checked).splitlines()]
    assert checked._repr_html_().count("<tr>") == 1 + arm.n
    drawn = checked.plot_residual(7).axes[0].lines[0].get_ydata()
    rms = np.sqrt(np.nanmean(drawn**2))
    assert rms == pytest.approx(checked.joints[6].rms, rel=0.02)
    with pytest.raises(dynid.errors.WrongUsage, match="joint '8'"):
        checked.plot_residual(8)


def test_names_from_files_stay_text_in_tables():
    shown = Table([{"joint": "<b>x\x1b[31m", "value": 1.0}])
    assert "<b>" not in shown._repr_html_()
    assert "\x1b" not in repr(shown)


def test_two_logs_of_one_name_get_folders_of_their_own(checked, tmp_path):
    first = checked.folder(tmp_path)
    checked.save(first)
    other = replace(checked, log_sha256="0123456789abcdef")
    assert checked.folder(tmp_path) == first == tmp_path / "lwr4plus_validate"
    assert other.folder(tmp_path) == tmp_path / "lwr4plus_validate_01234567"
