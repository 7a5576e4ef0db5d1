"""The situations whose answers are frozen: command lines in chapters, and the files that they meet.

A chapter is a folder of its own in which its command lines run one after the other. In a command line, ``{name}``
stands for one of ``PLACES``.
"""

import shutil
from pathlib import Path

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "trajectories"
PLACES = {
    "arm": "kuka_lwr4plus",
    "log": str(SHIPPED / "lwr4plus_identify.bag"),
    "unseen": str(SHIPPED / "lwr4plus_validate.bag"),
    "motion": str(SHIPPED / "kuka_lwr4plus_alpha1.0.npz"),
    "slow": str(SHIPPED / "kuka_lwr4plus_alpha0.2.npz"),
    "run": "out/kuka_lwr4plus",
    "result": "out/kuka_lwr4plus/parameters.npz",
}

#: Keys whose value is a map with names of its own: parameters, joints, stages, what a finding rests on.
OPEN_MAPS = {
    "base_parameters",
    "cannot_judge",
    "codes",
    "formulas",
    "inputs",
    "origin",
    "parameters",
    "predicted_std_error",
    "seconds",
    "symbols",
    "terms",
}
#: Keys whose value is a copy of something that is described elsewhere: what stands in it is not compared.
COPIES = {"arrays", "evidence", "header"}
#: Keys whose list or map may be empty where numbers move a little; what stands in them is compared where it is not.
MAY_BE_EMPTY = {
    "findings",
    "cannot_judge",
    "alternatives",
    "most_changed",
    "beyond_tolerance",
    "changed",
}

# ---------------------------------------------------------------- the files that commands meet
BATCH = """\
jobs:
  - name: lwr
    robot: kuka_lwr4plus
    logs: {log}
    validate: {unseen}
"""
URDF = """\
<robot name="two">
  <link name="base"/>
  <link name="upper"><inertial><mass value="2"/><origin xyz="0.2 0 0"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="30" velocity="2"/></joint>
</robot>
"""


def files(folder):
    """Write what the command lines name besides shipped files and results of earlier ones."""
    (folder / "batch.yaml").write_text(BATCH.format(**PLACES))
    (folder / "spoilt_batch.yaml").write_text(BATCH.format(**PLACES).replace("robot:", "robott:"))
    (folder / "two.urdf").write_text(URDF)
    (folder / "config.yaml").write_text("identify: {methood: ols}\n")
    shutil.copy(ROOT / "robots/scara.yaml", folder / "good.yaml")


def short_log(folder):
    """Write the first 0.3 s of log.csv, a recording of the shipped arm."""
    lines_ = (folder / "log.csv").read_text().splitlines(keepends=True)
    (folder / "short.csv").write_text("".join(lines_[:61]))


# ---------------------------------------------------------------- command lines; mistakes in files: test_mistakes.py
ANSWERS = {
    "loops": """
        model {arm} --json
        model {arm}
        check {arm} --json
        check {log} --robot {arm} --json
        check {log} --robot {arm} --convert --json -o converted
        check {log} --robot {arm} --fix --json -o fixed
        parameters {arm} {log} --no-identify --json
        identify {arm} {log} --json
        identify {arm} {log}
        check {result} --json
        check {run}/fullnumericregressor.npz --json
        report {run} --json
        validate {result} {unseen} --json
        validate {result} {unseen} --json --mcap replay.mcap --no-plot
        compare {run} --json --csv runs.csv --latex runs.tex --junit runs.xml
        check {arm} {log} {result} --json --strict
    """,
    "searches": """
        gap {result} {unseen} --json -o gaps
        gap {result} {unseen} --ask changed --json --no-plot --joints 2 -o changed
    """,
    "more of identify": """
        identify {arm} {log} --no-report --json
        identify {arm} {unseen} --no-report --json --update {result} -o updated
        identify {arm} {unseen} --no-report --json --payload-from {result} -o payload
        identify {arm} {log} --no-report --json --feasible --residual-model -o feasible
        identify {arm} {log} --no-report --json --method ols --holdout none --no-feasible -o ols
        identify {arm} {log} --no-report --json --fail-if heldout_relative_error_percent>50 -o limit
        identify --from updated/run.yaml --no-report --json -o again
        export {run} --format all --json
        export {run} --format urdf --set plain --json -o plain
        export {run} --format mjcf --format c --draws 2 --json -o drawn
        simulate {run} {run} --compare {unseen} --json
        compare updated --baseline {run} --json
        model scara --json --groups json
    """,
    "motions": """
        trajectory {arm} --no-optimise --duration 10 --segments 5 --preview picture --json
        trajectory {arm} --review {run}/trajectory.npz --preview none --json
        trajectory scara --no-optimise --basis spline --duration 10 --segments 5 --preview none --json
        check {run}/trajectory.npz --json
        simulate {arm} {motion} --json
        convert {unseen} -o log.npz --json
        convert log.npz -o log.csv --json
    """,
    "a list and the rest": """
        run batch.yaml --json --jobs 1 --junit results.xml
        run batch.yaml --json-lines --jobs 1
        import two.urdf --json
        demo --json
        doctor --json
        doctor --config --json
        explain E307 --json
        explain W402 --json
        explain --json
        completion bash --json
    """,
    "a hidden effect": """
        demo --effect spring --json
    """,
}

MISTAKES = {
    "wrong words": """
        frobnicate
        model
        model {arm} --no-such-option
        model {arm} --sam 100
        model {arm} --samples many
        model {arm} --json --samples many
        model no_such_robot
        model {arm} --gravity 1,2
        identify {arm} no_such_log.bag
        identify {arm} {log} --method no_such_method
        identify {arm} {log} --fail-if no_such_number>1
        identify {arm} {log} --holdout 300%
        identify {arm} {log} --config config.yaml
        parameters {arm}
        explain E999
        completion tcsh
        demo --effect no_such_effect
        export no_such_run --format urdf
        report no_such_run
        compare no_such_run
        run spoilt_batch.yaml
        convert {unseen} -o log.xyz
        import no_such.urdf
        simulate {arm} no_such.npz
        record {arm} {slow}
        sim-driver {arm}
        record {arm} no_such.npz
    """,
    "limits and decisions": """
        identify {arm} {log} --no-report
        identify {arm} {log} --no-report
        identify {arm} {unseen} --no-report
        identify {arm} {unseen} --no-report --json
        identify {arm} {log} --no-report --force
        identify {arm} {log} --no-report --force --fail-if max_rms_nm>0.000001
        validate {result} {log} --no-plot
        validate {result} {log} --no-plot --allow-training-data
        validate {result} {unseen} --no-plot --max-rms 0.000001
        validate {result} {unseen} --no-plot --max-unexplained 50%
        validate {result} {unseen} --no-plot --max-unexplained 0.0001% --json
        validate no_such.npz {unseen}
        validate {log} {unseen}
        gap {result} {log} --no-plot --joints 2
        gap {result}
        trajectory {arm} --no-optimise --alpha 40 --preview none
        check {slow} --robot scara
        record {arm} {slow} --dry-run
        identify {arm} {unseen} --no-report -o other
        compare other --baseline {run} --tolerance 0.001%
        check short.csv --robot {arm} --strict
        model good.yaml
        model good.yaml --frozen
        export {run} --format urdf
        export {run} --format urdf
    """,
}


def lines(text):
    """Return the command lines of a chapter."""
    return [line.strip() for line in text.strip().splitlines()]


#: Each chapter's command lines; the first words of a chapter may be commands that only prepare it.
CHAPTERS = {name: lines(text) for name, text in (ANSWERS | MISTAKES).items()}
#: What a chapter needs that other command lines make, without an entry in the table.
BEFORE = {
    "searches": lines("identify {arm} {log}"),
    "more of identify": lines("identify {arm} {log} --no-report"),
    "limits and decisions": lines("convert {log} -o log.csv"),
}
