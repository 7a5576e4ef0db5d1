"""The arm with the inertia ellipsoids of its links as PyBullet draws it; None where PyBullet is not installed."""

from __future__ import annotations

import base64
import io
import json
import subprocess
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid import children
from dynid.errors import CannotWrite
from dynid.model.kinematics import link_frames
from dynid.model.parameters import link_cylinders
from dynid.robot import Robot, roll_pitch_yaw
from dynid.scratch import scratch_folder
from dynid.sim.urdf import urdf_text
from dynid.text import html

Floats = NDArray[np.float64]

#: Time after which a child that draws is taken to hang [s].
PATIENCE = 60.0
#: How much of the arm is seen through a body.
THROUGH = 0.4


@dataclass(frozen=True)
class Ellipsoid:
    """A body on the arm.

    Attributes:
        name: what stands on it.
        link: number of the link it belongs to, from 1.
        centre: in the link's DH frame, (3,) [m].
        rotation: its axes in that frame, (3, 3).
        axes: semi-axes, (3,) [m].
        colour: ``#rrggbb``.
    """

    name: str
    link: int
    centre: Floats
    rotation: Floats
    axes: Floats
    colour: str


def ellipsoid_drawing(robot: Robot, q: Floats, bodies: list[Ellipsoid], label: str) -> str | None:
    """Return an SVG element with two views of the arm and its bodies.

    Args:
        robot: the arm.
        q: its pose, (n,) [rad or m].
        bodies: what is drawn on it; the arm is seen through them.
        label: what the drawing shows, for those who cannot see it.
    """
    if find_spec("pybullet") is None:
        return None
    # Why: the picture shows links by number, and PyBullet ends its process on some names.
    robot = replace(
        robot,
        joints=tuple(replace(joint, name=f"joint_{k}") for k, joint in enumerate(robot.joints)),
    )
    with scratch_folder() as folder:
        job = Path(folder) / "job.json"
        (Path(folder) / "arm.urdf").write_text(urdf_text(robot), encoding="utf-8")
        job.write_text(json.dumps(_job(robot, q, bodies)), encoding="utf-8")
        child = subprocess.run(
            children.command("dynid.sim.inertia_ellipsoids", str(job)),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            env=children.environment(),
            timeout=PATIENCE,
            check=False,
        )
        if child.returncode == children.MACHINE:
            raise CannotWrite(
                f"cannot draw the arm: {child.stderr.decode(errors='replace').strip().splitlines()[-1]}"
            )
        if child.returncode:
            raise RuntimeError(
                f"drawing the arm ended with status {child.returncode}:\n{child.stderr[-2000:]!r}"
            )
        with np.load(job.with_suffix(".npz"), allow_pickle=False) as arrays:
            views = dict(arrays)
    return _drawing(views, [body.name for body in bodies], label)


def _job(robot: Robot, q: Floats, bodies: list[Ellipsoid]) -> dict[str, object]:
    poses = link_frames(robot, q, world=True).poses
    shapes = zip(poses, link_cylinders(robot), strict=True)
    ends = [pose[:3, :3] @ end + pose[:3, 3] for pose, shape in shapes for end in shape]
    points = np.vstack([robot.base_xyz, *ends])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    rows = []
    for body in bodies:
        pose = poses[body.link - 1]
        turn = pose[:3, :3] @ body.rotation
        rows.append(
            {
                "centre": (pose[:3, :3] @ body.centre + pose[:3, 3]).tolist(),
                "turn": roll_pitch_yaw(turn * np.sign(np.linalg.det(turn))),
                "axes": body.axes.tolist(),
                "colour": [*(int(body.colour[k : k + 2], 16) / 255 for k in (1, 3, 5)), 1.0],
            }
        )
    # Why: the picture is about the arm; an absurd ellipsoid may leave it, the arm may not vanish beside it.
    reach = 1.15 * float(np.linalg.norm(points - middle, axis=1).max()) or 1.0
    return {
        "urdf": "arm.urdf",
        "joints": list(robot.joint_names),
        "q": q.tolist(),
        "middle": middle.tolist(),
        "reach": reach,
        "ellipsoids": rows,
    }


def _drawing(views: dict[str, NDArray[np.generic]], names: list[str], label: str) -> str:
    """Put the views side by side, each body's name on it."""
    size = views["arm"].shape[1]
    parts = []
    for k in range(len(views["arm"])):
        image = base64.b64encode(
            _png(*(views[name][k] for name in ("arm", "arm_there", "bodies", "bodies_there")))
        )
        parts.append(
            f'<image x="{k * size}" width="{size}" height="{size}" href="data:image/png;base64,{image.decode()}"/>'
        )
        for name, (x, y) in zip(names, views["labels"][k].astype(float), strict=True):
            parts.append(f'<text x="{k * size + x:.1f}" y="{y + 5:.1f}">{html(name)}</text>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {len(views["arm"]) * size} {size}" role="img" '
        f'aria-label="{html(label)}"><g fill="currentColor" stroke="var(--paper)" stroke-width="3" '
        f'paint-order="stroke" font-size="14" text-anchor="middle">{"".join(parts)}</g></svg>'
    )


def _png(arm: Floats, arm_there: Floats, bodies: Floats, bodies_there: Floats) -> bytes:
    """Return a PNG of the arm with its bodies over it, clear where nothing is."""
    from PIL import Image

    both = (1 - THROUGH) * bodies + THROUGH * arm
    picture = np.where(bodies_there[..., None], np.where(arm_there[..., None], both, bodies), arm)
    there = np.where(arm_there, 1.0, np.where(bodies_there, 1 - THROUGH, 0.0))
    pixels = np.dstack([picture, 255 * there]).round().astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(stream, "PNG")
    return stream.getvalue()
