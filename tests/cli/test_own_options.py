"""The working folder is somebody else's: what a file of it may set, and what only the user may."""

import json

import numpy as np
import pytest
import yaml

ARM = """name: one
convention: standard
gravity: [0, -9.81, 0]
joints:
  - {name: j, a: 0.3, d: 0, twist: 0}
"""
#: A line of dynid.yaml, and the command that meets it.
REFUSED = {
    "log_file: said": "check arm.yaml",
    "limit: [archive_bytes=1e15]": "check arm.yaml",
    "force: true": "check arm.yaml",
    "yes: true": "check arm.yaml",
    "out: /tmp/elsewhere": "model arm.yaml",
    "out: ../elsewhere": "model arm.yaml",
    "model: {out: link/x}": "model arm.yaml",
    "run: {scheduler: 'tcp://127.0.0.1:1'}": "run batch.yaml",
    "run: {junit: /tmp/j.xml}": "run batch.yaml",
    "identify: {open: true}": "identify arm.yaml log.csv",
    "identify: {prior: ../prior.yaml}": "identify arm.yaml log.csv",
    "identify: {holdout: 's3://bucket/log.npz'}": "identify arm.yaml log.csv",
    "trajectory: {accept: true}": "trajectory arm.yaml",
    "record: {master: 'http://evil:11311'}": "record arm.yaml trajectory.npz",
    "record: {max_deviation: 90 rad}": "record arm.yaml trajectory.npz",
}


@pytest.fixture
def lab(dynid):
    texts = {
        "arm.yaml": ARM,
        "batch.yaml": "jobs: []",
        "log.csv": "t,q_j\n",
    }
    for name, text in texts.items():
        (dynid.folder / name).write_text(text)
    (dynid.folder / "trajectory.npz").write_bytes(b"")
    (dynid.folder / "link").symlink_to("/tmp")
    return dynid


@pytest.mark.parametrize("text", REFUSED)
@pytest.mark.parametrize("where", ["dynid.yaml", "--config"])
def test_a_file_of_the_folder_does_not_set_what_reaches_out_of_it(text, where, lab):
    (lab.folder / ("dynid.yaml" if where == "dynid.yaml" else "other.yaml")).write_text(f"{text}\n")
    done = lab(
        *REFUSED[text].split(), *([] if where == "dynid.yaml" else ["--config", "other.yaml"])
    )
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("error[E101]")
    assert "only you may set" in done.err or "leads out of the folder" in done.err
    assert "on the command line, or in " in done.err
    assert not (lab.folder / "said").exists()


@pytest.mark.parametrize("text", ["log_file: said", "force: true", "limit: [joints=40]"])
def test_the_users_own_file_sets_everything(text, lab):
    own = lab.home / ".config/dynid/config.yaml"
    own.parent.mkdir(parents=True)
    own.write_text(f"{text}\n")
    assert lab("check", "arm.yaml").status == 0


def test_what_a_file_of_the_folder_sets_is_said(lab):
    (lab.folder / "dynid.yaml").write_text("seed: 7\nout: results\n")
    assert "settings   dynid.yaml sets seed, out" in lab("model", "arm.yaml", "--no-input").err
    assert "settings" not in lab("model", "arm.yaml", "--no-input", "--seed", "1", "--out", "o").err


@pytest.mark.parametrize(
    "word", ["--log-file=said", "--limit=joints=40", "--out=/tmp/elsewhere", "--open", "--force"]
)
def test_a_run_of_somebody_else_is_not_repeated_with_what_only_the_user_may_say(word, lab):
    stored = {"identify": {"arguments": ["arm.yaml", "log.csv", word]}}
    (lab.folder / "run.yaml").write_text(yaml.safe_dump(stored))
    done = lab("identify", "--from", "run.yaml")
    assert done.status == 2
    assert f"run.yaml sets {word.split('=')[0]}" in done.err
    assert not (lab.folder / "said").exists()


def test_what_is_given_besides_stands_in_for_a_path_that_leads_out_of_the_folder(lab):
    stored = {"identify": {"arguments": ["arm.yaml", "log.csv", "--out", "/tmp/elsewhere"]}}
    (lab.folder / "run.yaml").write_text(yaml.safe_dump(stored))
    assert "sets --out" not in lab("identify", "--from", "run.yaml", "--out", "here").err


def test_a_job_of_a_list_opens_no_window(lab):
    t = np.arange(300) / 100
    rows = np.column_stack([t, np.sin(t), t])
    np.savetxt(lab.folder / "log.csv", rows, delimiter=",", header="t,q_j,tau_j", comments="")
    (lab.folder / "batch.yaml").write_text(
        json.dumps(
            {"jobs": [{"robot": "arm.yaml", "logs": ["log.csv"], "options": {"open": True}}]}
        )
    )
    done = lab("run", "batch.yaml")
    assert done.status == 2
    assert "has no option 'open'" in done.err


@pytest.mark.parametrize(
    "variables",
    [
        {"_DYNID_COMPLETE": "bash_complete", "COMP_WORDS": "dynid identfy ", "COMP_CWORD": "2"},
        {"_DYNID_COMPLETE": "bash_complete", "COMP_WORDS": "dynid 'open", "COMP_CWORD": "1"},
        {"_DYNID_COMPLETE": "bash_complete", "COMP_WORDS": "dynid x", "COMP_CWORD": "many"},
        {"_DYNID_COMPLETE": "bash_complete"},
        {"_DYNID_COMPLETE": "zsh_complete", "COMP_WORDS": "dynid identify --", "COMP_CWORD": "2"},
        {"_DYNID_COMPLETE": "nonsense"},
        {"_DYNID_COMPLETE": ""},
    ],
)
def test_completion_says_nothing_where_the_words_are_wrong(variables, lab):
    (lab.folder / "dynid.yaml").write_text("log_file: said\nseeed: 1\n")
    done = lab.fresh(**variables)
    assert "Traceback" not in done.err
    assert done.err == ""
    assert not (lab.folder / "said").exists()


def test_each_option_that_is_the_users_own_is_one_of_a_command():
    import importlib

    from dynid.cli import own
    from dynid.cli.main import available, module_of
    from dynid.cli.options import key_of

    commands = [importlib.import_module(module_of(name)).command for name in available()]
    names = {
        key_of(param)
        for command in commands
        for param in command.params
        if param.opts[0].startswith("-")
    }
    assert set(own.OPTIONS) <= names
    assert set(own.COMMANDS) <= set(available())
