"""A report of a result in memory says the same as that of its files."""

import html
import re

import numpy as np

import twolink
from dynid import identify, report
from dynid.loading import load_run
from dynid.reports.gathered import gather
from dynid.workflows.identify import save_result


def test_a_new_result_has_a_report_with_its_motion_and_excitation(result):
    made = report(result)
    assert made.judgement.sentence == result.judgement.sentence
    shown = made._repr_html_()
    assert all(html.escape(sentence) in shown for sentence in made.judgement.sentences)
    assert all(light.title in shown for light in made.judgement.lights)
    assert [light.name for light in made.judgement.lights] == [
        "fit",
        "unseen motion",
        "knowledge",
        "physics",
        "complete",
    ]
    assert [
        label.split(" of ")[0] for label in re.findall(r'<img [^>]*alt="([^"]*)"', made.html)
    ] == [
        "singular values",
        "range",
        "measured and estimated torque",
        "mean and spread",
    ]


def test_it_is_the_report_of_the_saved_result(arm, tmp_path):
    """Motion and torque from memory and from estimatedmotion.npz are the same arrays, with a residual model too."""
    result = identify(arm, [twolink.log(1)], residual_model=True)
    save_result(tmp_path, result)
    stored = load_run(tmp_path)
    memory, disk = gather(result), gather(stored)
    for name, values in vars(memory.motion).items():
        np.testing.assert_array_equal(values, getattr(disk.motion, name))
    assert report(stored).judgement.sentences == report(result).judgement.sentences


def test_the_singular_values_are_those_of_the_stack_with_columns_of_unit_length(result):
    rows = result.stack.rows.W[result.stack.rows.use]
    expected = np.linalg.svd(rows / np.linalg.norm(rows, axis=0), compute_uv=False)
    np.testing.assert_allclose(gather(result).singular_values, expected, rtol=1e-6)


def test_files_in_the_working_directory_are_not_taken_for_those_of_a_new_result(
    result, tmp_path, monkeypatch
):
    (tmp_path / "estimatedmotion.npz").write_bytes(b"not an archive")
    (tmp_path / "gap.npz").write_bytes(b"not an archive")
    monkeypatch.chdir(tmp_path)
    assert gather(result).gap is None
