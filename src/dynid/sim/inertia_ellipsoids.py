"""The child process that draws bodies on an arm: PyBullet's software renderer, no display; run by ``report/`` only.

PyBullet prints from C and may end its process, so it never runs in dynid's own. Reads a job (JSON); writes one .npz
with two views, each the arm alone, the ellipsoids alone, where those are, and where their centres are in the picture.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Width and height of a view.
SIZE = 460
#: The camera's field of view [deg] and where it looks from: turned about z [deg].
FIELD, YAWS = 34.0, (25.0, 115.0)
#: Rings and points per ring of the sphere that ellipsoids are made of.
RINGS, ROUND = 24, 48
_ARM = (0.62, 0.64, 0.67, 1.0)


def sphere() -> str:
    """Return a unit sphere as an OBJ file's text."""
    up, around = np.linspace(0, np.pi, RINGS + 1), np.linspace(0, 2 * np.pi, ROUND, endpoint=False)
    u, v = (grid.ravel() for grid in np.meshgrid(up, around, indexing="ij"))
    points = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=1)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
    for ring in range(RINGS):
        for k in range(ROUND):
            a, b = ring * ROUND + k, ring * ROUND + (k + 1) % ROUND
            corners = (a, a + ROUND, b + ROUND, b)
            for face in (corners[:3], (corners[0], corners[2], corners[3])):
                lines.append("f " + " ".join(f"{i + 1}//{i + 1}" for i in face))
    return "\n".join([*lines, ""])


def draw(job: dict[str, Any], folder: Path) -> dict[str, NDArray[Any]]:
    """Return two views of a job: pictures of the arm and of the bodies, (2, SIZE, SIZE, 3), and where something is."""
    import pybullet

    pybullet.connect(pybullet.DIRECT)
    cameras = [_camera(pybullet, job["middle"], job["reach"], yaw) for yaw in YAWS]
    arm = pybullet.loadURDF(str(folder / job["urdf"]), useFixedBase=True)
    index = {
        pybullet.getJointInfo(arm, k)[1].decode(): k for k in range(pybullet.getNumJoints(arm))
    }
    for name, value in zip(job["joints"], job["q"], strict=True):
        pybullet.resetJointState(arm, index[name], value)
    for k in range(-1, len(index)):
        pybullet.changeVisualShape(arm, k, rgbaColor=_ARM)
    behind = [_shot(pybullet, camera) for camera in cameras]
    pybullet.removeBody(arm)
    (folder / "sphere.obj").write_text(sphere(), encoding="ascii")
    for one in job["ellipsoids"]:
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            fileName=str(folder / "sphere.obj"),
            meshScale=one["axes"],
            rgbaColor=one["colour"],
        )
        pybullet.createMultiBody(
            0, -1, shape, one["centre"], pybullet.getQuaternionFromEuler(one["turn"])
        )
    before = [_shot(pybullet, camera) for camera in cameras]
    points = np.array([[*one["centre"], 1.0] for one in job["ellipsoids"]])
    found = {"labels": np.array([_projected(camera, points) for camera in cameras])}
    for name, shots in (("arm", behind), ("bodies", before)):
        found |= {
            name: np.array([shot[0] for shot in shots]),
            f"{name}_there": np.array([shot[1] for shot in shots]),
        }
    return found


def _camera(
    bullet: Any,  # noqa: ANN401
    middle: list[float],
    reach: float,
    yaw: float,
) -> tuple[list[float], list[float]]:
    """Return the view and projection matrices of a camera that sees the whole arm."""
    far = reach / np.tan(np.radians(FIELD / 2))
    view = bullet.computeViewMatrixFromYawPitchRoll(middle, far, yaw, -12, 0, 2)
    return view, bullet.computeProjectionMatrixFOV(FIELD, 1.0, 0.05 * far, 3 * far)


def _shot(
    bullet: Any,  # noqa: ANN401
    camera: tuple[list[float], list[float]],
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return a picture, (SIZE, SIZE, 3), and where something is in it, (SIZE, SIZE)."""
    light = {"lightDirection": [1, -1, 2], "shadow": 0, "renderer": bullet.ER_TINY_RENDERER}
    _, _, colours, _, things = bullet.getCameraImage(SIZE, SIZE, *camera, **light)
    picture = np.reshape(colours, (SIZE, SIZE, 4))[:, :, :3].astype(np.uint8)
    return picture, np.reshape(things, (SIZE, SIZE)) >= 0


def _projected(camera: tuple[list[float], list[float]], points: Floats) -> Floats:
    """Return where points, (L, 4), are in the picture, (L, 2) from its upper left corner [pixel]."""
    view, projection = (np.reshape(matrix, (4, 4)).T for matrix in camera)
    seen = points @ view.T @ projection.T
    flat = seen[:, :2] / seen[:, 3:]
    return np.asarray(SIZE / 2 * np.stack([1 + flat[:, 0], 1 - flat[:, 1]], axis=1))


if __name__ == "__main__":
    place = Path(sys.argv[1])
    found: dict[str, Any] = {**draw(json.loads(place.read_text(encoding="utf-8")), place.parent)}
    np.savez(place.with_suffix(".npz"), **found)
