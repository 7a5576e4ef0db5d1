"""The picture of the bodies: PyBullet draws them where they are and as large as they are."""

import base64
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from dynid.files.robotfile import load_robot
from dynid.reports.inertia_ellipsoids import THROUGH, Ellipsoid, ellipsoid_drawing
from dynid.reports.sections.physics import ellipsoid, ellipsoids

pytest.importorskip("pybullet", reason="no PyBullet for this Python")
BLUE = "#0072b2"


def pictures(svg):
    """Return the views as arrays and the place of each label in the first."""
    found = [
        np.asarray(Image.open(io.BytesIO(base64.b64decode(code))))
        for code in re.findall(r"data:image/png;base64,([^\"]+)", svg)
    ]
    labels = [
        (float(x), float(y) - 5) for x, y in re.findall(r'<text x="([\d.]+)" y="([\d.]+)"', svg)
    ]
    return found, labels


def ball(size, link=1, centre=(0.0, 0.0, 0.0)):
    return Ellipsoid("b", link, np.array(centre), np.eye(3), np.array(size), BLUE)


def blue(view):
    """Return where a blue body is, over the arm or beside it."""
    red, green, sky, seen = (view[..., k].astype(int) for k in range(4))
    return (seen > 0) & (sky > red + 25) & (sky > green + 5)


@pytest.fixture(scope="module")
def arm():
    return load_robot("scara")


def test_a_body_is_drawn_around_its_label_in_both_views(arm):
    """The label comes from the projection of its centre, the pixels from the renderer."""
    pose = np.array([0.3, 0.4, 0.0, 0.0])
    views, labels = pictures(ellipsoid_drawing(arm, pose, [ball((0.1, 0.1, 0.1), link=2)], "x"))
    width = views[0].shape[1]
    for k, (view, (x, y)) in enumerate(zip(views, labels, strict=True)):
        rows, columns = np.nonzero(blue(view))
        assert abs(columns.mean() + k * width - x) < 4
        assert abs(rows.mean() - y) < 4


def test_a_body_twice_as_large_covers_four_times_the_pixels(arm):
    sizes = [(0.05,) * 3, (0.1,) * 3]
    one, two = (
        blue(pictures(ellipsoid_drawing(arm, np.zeros(4), [ball(s)], "x"))[0][0]).sum()
        for s in sizes
    )
    assert two / one == pytest.approx(4, rel=0.08)


def test_the_paper_shows_beside_the_arm_and_through_bodies(arm):
    """So that the picture sits on light and dark pages alike."""
    view = pictures(
        ellipsoid_drawing(arm, np.zeros(4), [ball((0.1, 0.1, 0.1), centre=(0.0, 0.0, 0.08))], "x")
    )[0][0]
    assert set(np.unique(view[..., 3])) == {0, round(255 * (1 - THROUGH)), 255}
    assert not view[0, :, 3].any()


def test_the_ellipsoid_of_a_uniform_ellipsoid_is_that_ellipsoid():
    """Its inertia is m/5 (b^2 + c^2) about the first axis."""
    a, b, c, mass = 0.1, 0.2, 0.3, 4.0
    moments = mass / 5 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    tensor = dict(
        zip(
            ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
            np.diag(moments)[np.triu_indices(3)],
            strict=True,
        )
    )
    link = {
        "link": 1,
        "mass_kg": mass,
        "com_m": [0, 0, 0],
        "inertia_com_kg_m2": tensor,
        "origin": {},
    }
    np.testing.assert_allclose(sorted(ellipsoid(link).axes), [a, b, c], rtol=1e-12)


def test_without_pybullet_the_outlines_are_drawn(arm, monkeypatch):
    monkeypatch.setattr("dynid.reports.inertia_ellipsoids.find_spec", lambda name: None)
    tensor = {"ixx": 0.01, "ixy": 0.0, "ixz": 0.0, "iyy": 0.02, "iyz": 0.0, "izz": 0.02}
    links = [
        {"link": k, "mass_kg": 1.0, "com_m": [0.1, 0, 0], "inertia_com_kg_m2": tensor, "origin": {}}
        for k in (1, 2)
    ]
    picture = ellipsoids(arm, links)
    assert picture.svgs[0].startswith("<svg")
    assert "image/png" not in picture.svgs[0]


def test_names_of_joints_and_labels_stay_text(arm):
    nasty = replace(arm, joints=(replace(arm.joints[0], name='<b>x & "y"</b>'), *arm.joints[1:]))
    svg = ellipsoid_drawing(
        nasty, np.zeros(4), [replace(ball((0.1, 0.1, 0.1)), name="<i>")], '<b>"'
    )
    assert "<b>" not in svg
    assert "<i>" not in svg
