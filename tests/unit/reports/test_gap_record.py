"""What ``dynid gap`` found comes back from its file and stands in the report as text."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import NotAnArtifact
from dynid.files.artifact import Artifact, write_artifact
from dynid.gap.localisation import JointGap, ResidualRegion
from dynid.gap.refit import HeldOutImprovement
from dynid.reports.gap_record import SCHEMA, load, save
from dynid.reports.page import page

NASTY = '<b>x & "y"</b>'


@pytest.fixture
def record(tmp_path, evidence):
    names = [joint.name for joint in evidence.robot.joints]
    n = len(names)
    one = {
        "effect": "load_friction", "joints": [names[0]], "p_value": 2e-5, "heldout_rms_before_nm": 0.9,
        "heldout_rms_after_nm": 0.36, "parameters": {"a": {"value": 0.05, "unit": "", "std_error": 0.002}},
    }  # fmt: skip
    answer = {
        "verdict": "named", "named": [one], "closest": [{**one, "effect": "stribeck", "why_not": NASTY}],
        "alternatives": [], "advice": NASTY,
    }  # fmt: skip
    regions = (ResidualRegion("speed", "slow", 4.0, 100), ResidualRegion("speed", "fast", 1.1, 100))
    where = [JointGap(j, 2.5, 1 / n, regions, "when slow") for j in range(n)]
    shrink = HeldOutImprovement(np.full(n, 0.9), np.full(n, 0.36), np.tile([0.3, 0.5], (n, 1)), np.full(n, 0.3))
    save(tmp_path / "gap.npz", answer, [tmp_path / NASTY.replace("/", "")], where, shrink)
    return load(tmp_path / "gap.npz"), where, shrink


def test_a_search_comes_back_from_its_file(record):
    found, where, shrink = record
    assert found.answer["verdict"] == "named"
    assert list(found.where) == where
    np.testing.assert_array_equal(found.improvement.ratio, shrink.ratio)


def test_the_report_names_the_effect_its_numbers_and_what_was_not_taken(record, evidence):
    html = page(replace(evidence, gap=record[0], motion=None, unseen=(), singular_values=None))
    section = html[html.index('id="gap"') : html.index('id="physics"')]
    for text in ("friction that grows with the load", "0.9 → 0.36", "−60 %", "&lt; 0.1 %", "a = 0.05 ± 0.002"):
        assert text in section, text
    assert section.count("<svg ") == 2
    assert "<b>x" not in html


def test_a_file_of_another_kind_is_refused(tmp_path):
    write_artifact(tmp_path / "gap.npz", Artifact(SCHEMA, {"answer": {}}, {}))
    with pytest.raises(NotAnArtifact):
        load(tmp_path / "gap.npz")
