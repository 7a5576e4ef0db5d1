"""Names from files cannot become code, markup or a second element in any exported file; nothing of them is run."""

import ast
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from arms import random_robot
from export_cases import made

from dynid.errors import NotAnArtifact, TooLarge, WrongRobotFile
from dynid.exporters import FORMATS, Provenance
from dynid.files.artifact import read_artifact
from dynid.files.robotfile import parse_robot
from dynid.limits import limit
from dynid.model.base_model import BaseModel, load_model, save_model
from dynid.model.regressor import build_model
from dynid.npz import write_artifact
from dynid.text import printable

#: Code for each language, led in by what ends a comment, a string or a line there, or joins lines.
ATTACKS = {
    "line break in Python": "arm\nopen('HACKED', 'w')\n",
    "carriage return": "arm\ropen('HACKED', 'w')\r",
    "other line ends": "arm\x0bopen('HACKED', 'w')\x0c\x1c\x85\u2028open('HACKED', 'w')\u2029",
    "triple quotes": '"""\nopen("HACKED", "w")\n"""',
    "backslash before quotes": '\\"""\nopen("HACKED", "w")\n\\',
    "named character": "\\N{NULL} \\x \\u12",
    "end of a C comment": '*/ __attribute__((constructor)) void f(void) { fopen("HACKED", "w"); } /*',
    "end over spliced lines": '*\\\n/ __attribute__((constructor)) void f(void) { fopen("HACKED", "w"); } /\\\n*',
    "end over a trigraph": '*??/\n/ __attribute__((constructor)) void f(void) { fopen("HACKED", "w"); } /??/\n*',
    "directive": '*/\n#include "/etc/passwd"\n/*',
    "line break in MATLAB": "arm\nsystem('touch HACKED');\n%",
    "block comment of MATLAB": "arm\n%{\n",
    "continuation of MATLAB": "arm ...\nsystem('touch HACKED')",
    "NUL": "arm\x00*/\x00",
    "reordering": "\u202e*/ \u2066arm\u2069",
    "XML": 'arm"/> --> <link name="evil"/> <!-- --- --->- & ]]>',
    "template": "${inertial} {value} %s $head",
    "not ASCII": "Müller 表",
}
every = pytest.mark.parametrize("name", ATTACKS.values(), ids=ATTACKS.keys())


def named(name, joint=None):
    """A small arm whose robot, joints, file, parameters, method and logs are all called that."""
    robot = random_robot(np.random.default_rng(0), n=2)
    joints = tuple(replace(j, name=f"{joint or name}{i}") for i, j in enumerate(robot.joints))
    arm = made(
        replace(robot, name=name, path=Path(f"{name.replace('/', '_')}.yaml"), joints=joints)
    )
    reduction = arm.base.reduction
    changed = replace(reduction, names=tuple(f"{name}{k}" for k in range(len(reduction.names))))
    base = BaseModel(arm.base.model, changed)
    known = (name,) * len(arm.known)
    return replace(
        arm, base=base, known=known, provenance=Provenance(name, name, name, 1.0, (name, name))
    )


@pytest.fixture(scope="module")
def plain():
    return named("arm")


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder to run in; an attack that succeeds leaves a file there."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert not (tmp_path / "HACKED").exists()


def preprocessed(text, folder):
    """Return C without comments, with trigraphs and spliced lines resolved, as the compiler sees it."""
    (folder / "arm.c").write_text(text, encoding="utf-8")
    words = ["cc", "-std=c99", "-E", "-P", "-nostdinc", "-D_MATH", str(folder / "arm.c")]
    (folder / "math.h").write_text("")
    (folder / "string.h").write_text("")
    done = subprocess.run(
        [*words[:-1], f"-I{folder}", words[-1]], capture_output=True, text=True, check=True
    )
    return done.stdout


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@every
def test_c_is_the_same_code_under_every_name_and_runs(name, plain, here):
    """The preprocessor sees no difference; the compiled file has dynid's torques and leaves nothing behind."""
    arm = named(name)
    text = FORMATS["c"].text(arm)
    assert preprocessed(text, here) == preprocessed(FORMATS["c"].text(plain), here)
    (agreement,) = FORMATS["c"].check(text, arm)
    assert agreement.agrees


@every
def test_python_is_the_same_code_under_every_name_and_runs(name, plain, here):
    """The syntax tree differs in the docstring and in the texts of NAMES only."""

    def tree(text):
        module = ast.parse(text)
        assert isinstance(module.body[0].value, ast.Constant)
        names = next(node for node in module.body if ast.unparse(node).startswith("NAMES"))
        assert all(isinstance(element, ast.Constant) for element in names.value.elts)
        return [ast.dump(node) for node in module.body[1:] if node is not names]

    arm = named(name)
    text = FORMATS["python"].text(arm)
    assert text.isascii()
    assert tree(text) == tree(FORMATS["python"].text(plain))
    (agreement,) = FORMATS["python"].check(text, arm)
    assert agreement.agrees


@every
def test_matlab_is_the_same_code_under_every_name(name, plain):
    """Every line without its comment is that of a plainly named arm, but for the name of the function."""

    def code(arm):
        text = FORMATS["matlab"].text(arm)
        assert text.isascii()
        assert not re.search(r"[^\n -~]", text)
        lines = text.split("\n")
        function = re.fullmatch(
            r"function out = ([A-Za-z][A-Za-z0-9_]*)\(what, q, qd, qdd, memory\)", lines[0]
        )[1]
        return [
            re.sub(r"%(?!s', what).*", "", line.replace(f"'{function}:", "'arm:")).rstrip()
            for line in lines[1:]
        ]

    assert code(named(name)) == code(plain)


def tags(text):
    """Return the elements and comments of an XML text, with the number of attributes."""
    parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    return [
        (element.tag, len(element.attrib)) for element in ET.fromstring(text, parser=parser).iter()
    ]


@pytest.mark.parametrize("format", ["urdf", "mjcf"])
@every
def test_simulators_read_the_same_elements_under_every_name(name, format, plain, here):
    """Joints have their names, with what XML forbids written out, and every engine finds them by it."""
    arm = named(name)
    text = FORMATS[format].text(arm)
    assert tags(text) == tags(FORMATS[format].text(plain))
    names = [joint.get("name") for joint in ET.fromstring(text).iter("joint")]
    assert names == [printable(joint) for joint in arm.robot.joint_names]
    found = FORMATS[format].check(text, arm)
    assert found
    assert all(agreement.agrees for agreement in found)


@every
def test_yaml_holds_every_name_exactly(name):
    document = yaml.safe_load(FORMATS["yaml"].text(named(name)))
    assert document["robot"] == name
    assert [link["joint"] for link in document["links"]] == [f"{name}0", f"{name}1"]


@every
def test_comments_of_a_users_urdf_cannot_be_ended(name, tmp_path):
    """Names of the links and of the robot stand in a comment of the changed file."""
    urdf = FORMATS["urdf"].text(named("arm"))
    path = tmp_path / "own.urdf"
    link = printable(name)
    root = ET.fromstring(urdf)
    for element in root.iter():
        for key, value in element.attrib.items():
            element.set(key, value.replace("link_1", link))
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    changed = FORMATS["urdf"].text(replace(named(name, joint="arm"), urdf=path))
    assert [tag for tag in tags(changed) if tag[0] is not ET.Comment] == [
        tag for tag in tags(ET.tostring(root, encoding="unicode")) if tag[0] is not ET.Comment
    ]


def test_what_lies_in_the_folder_of_the_results_is_not_run(here):
    """Modules, libraries and caches there belong to somebody else."""
    for name in ("numpy.py", "arm.py", "arm.c", "math.h", "dynid_exported.py"):
        (here / name).write_text("#error\nopen('HACKED', 'w')")
    arm = named("arm")
    for format in ("c", "python"):
        (agreement,) = FORMATS[format].check(FORMATS[format].text(arm), arm)
        assert agreement.agrees


@pytest.mark.parametrize(
    "name", ['q1;fopen("HACKED","w");double q2', "q1\n", "__import__('os')", "c99", "q0"]
)
def test_a_stored_model_with_other_variables_is_damaged(name, tmp_path):
    """Names of inputs become variables of the code."""
    robot = random_robot(np.random.default_rng(0), n=2)
    path = tmp_path / "regressor.npz"
    save_model(path, build_model(robot))
    stored = read_artifact(path)
    inputs = [name, *stored.header["program_inputs"][1:]]
    write_artifact(path, stored.schema, {**stored.header, "program_inputs": inputs}, stored.arrays)
    with pytest.raises(NotAnArtifact, match="damaged"):
        load_model(path, robot)


def test_a_stored_model_of_a_larger_arm_is_damaged(tmp_path):
    """Its entries would be written beyond the arrays of the C file."""
    save_model(tmp_path / "regressor.npz", build_model(random_robot(np.random.default_rng(0), n=3)))
    with pytest.raises(NotAnArtifact, match="its joints do not match"):
        load_model(tmp_path / "regressor.npz", random_robot(np.random.default_rng(0), n=2))


@pytest.mark.parametrize("name", ["''", "a" * (int(limit("name_length")) + 1)])
@pytest.mark.parametrize("place", ["robot", "joint"])
def test_a_name_that_crashes_simulators_is_refused_in_the_robot_file(name, place, tmp_path):
    names = {"robot": "arm", "joint": "shoulder"} | {place: name}
    text = f"name: {names['robot']}\nconvention: standard\njoints:\n  - {{name: {names['joint']}, a: 0.4}}\n"
    with pytest.raises((WrongRobotFile, TooLarge), match="characters"):
        parse_robot(text, tmp_path / "arm.yaml")
