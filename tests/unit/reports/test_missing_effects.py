"""What ``dynid gap`` found stands in the report as text, whatever it is called."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import NotAnArtifact
from dynid.files.gapfile import SCHEMA, read_record
from dynid.judgement.gap import GapEffect, GapRecord, HeldOutEffect, HeldOutImprovement, JointGap
from dynid.npz import write_artifact
from dynid.reports.gap_figures import effect_figure
from dynid.reports.page import page
from dynid.reports.section_figures import binned

NASTY = '<b>x & "y"</b>'


@pytest.fixture
def record(gathered):
    names = gathered.robot.joint_names
    n = len(names)
    one = GapEffect(
        effect="load_friction",
        title="friction that grows with the load",
        where=names[0],
        indices=(0,),
        joints=names[:1],
        sizes=(("a", 0.05, 0.002, ""),),
        p_value=2e-5,
        joint=names[0],
        rms_before=0.9,
        rms_after=0.36,
        rival_keys=(("end_stop", (1,)),),
    )
    regions = (("speed", "slow", 4.0), ("speed", "fast", 1.1))
    joints = tuple(JointGap(j, 2.5, 1 / n, regions, "when slow") for j in range(n))
    improvement = HeldOutImprovement(
        np.full(n, 0.9), np.full(n, 0.36), np.tile([0.3, 0.5], (n, 1)), np.full(n, 0.3), np.zeros(n)
    )
    t = np.linspace(0, 20, 500)
    curve = HeldOutEffect(np.sin(t), 0.9 * np.sin(t), np.cos(t), f"speed of {NASTY} [rad/s]")
    return GapRecord(
        robot=NASTY,
        verdict="named",
        named=(one,),
        closest=(replace(one, effect="stribeck", why_not=NASTY),),
        advice=NASTY,
        joint_names=names,
        torque_units=tuple(joint.torque_unit for joint in gathered.robot.joints),
        joints=joints,
        improvement=improvement,
        heldout="the last",
        noise_from="repeats",
        not_repeatable=(names[0],),
        cannot_judge={"base_tilt": (), "spring": (0, 1)},
        logs=(NASTY,),
        made_from="a",
        curves=(curve,),
    )


def test_the_report_names_the_effect_its_numbers_and_what_was_not_taken(record, gathered):
    html = page(replace(gathered, gap=record, motion=None, validations=(), singular_values=None))
    section = html[html.index('id="gap"') : html.index('id="physics"')]
    for text in (
        "friction that grows with the load",
        "0.9 → 0.36",
        "−60 %",
        "&lt; 0.1 %",
        "a = 0.05 ± 0.002",
    ):
        assert text in section, text
    assert "load_friction or end_stop" in section
    assert section.count("<img ") == 3
    assert "<b>x" not in html


def test_a_file_of_another_kind_is_refused(tmp_path):
    write_artifact(tmp_path / "gap.npz", SCHEMA, {"answer": {}}, {})
    with pytest.raises(NotAnArtifact):
        read_record(tmp_path / "gap.npz")


def test_the_figure_of_an_effect_shows_its_torque_over_what_it_follows(record):
    ((one, curve),) = record.drawn()
    (axis,) = effect_figure(one, curve, "").axes
    (line,) = (line for line in axis.get_lines() if line.get_label() == "the effect")
    centre, mean, _ = binned(curve.against, curve.torque)
    np.testing.assert_array_equal(line.get_xydata(), np.column_stack([centre, mean]))
    assert axis.get_xlabel().endswith("[rad/s]")
