"""Sets fitted to poor logs load in MuJoCo and PyBullet and move as their parameters say; least-squares sets do not."""

import numpy as np
import pytest
from synthetic_arm import OFFSET, TWIST

from dynid.estimation.possible_arm import fit_physical, fit_pooled

mujoco = pytest.importorskip("mujoco")

FITS = {"entropic": fit_physical, "pooled": lambda *given: fit_pooled(*given)[0]}


def bodies_of(x):
    """Mass, centre of mass and inertia about it of each link; the centre of mass is undefined without mass."""
    for m, *rest in x[:77].reshape(7, 11)[:, :10]:
        c = np.array(rest[:3]) / m
        xx, xy, xz, yy, yz, zz = rest[3:]
        about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        yield m, c, about_origin - m * (c @ c * np.eye(3) - np.outer(c, c))


def numbers(values):
    return " ".join(f"{value:.17g}" for value in values)


def mjcf(x):
    tree = ""
    for i, (m, c, I) in reversed(list(enumerate(bodies_of(x)))):
        lift, twist = (OFFSET[i - 1], TWIST[i - 1]) if i else (0.0, 0.0)
        inertia = numbers([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
        tree = (
            f'<body pos="0 0 {lift}" axisangle="1 0 0 {twist:.17g}">'
            f'<inertial pos="{numbers(c)}" mass="{m:.17g}" fullinertia="{inertia}"/>'
            f'<joint axis="0 0 1" armature="{x[11 * i + 10]:.17g}" damping="{x[77 + 2 * i]:.17g}"/>{tree}</body>'
        )
    return f'<mujoco><compiler angle="radian" boundmass="0"/><worldbody>{tree}</worldbody></mujoco>'


def urdf(x):
    links, joints = '<link name="base"/>', ""
    for i, (m, c, I) in enumerate(bodies_of(x)):
        tensor = {
            "ixx": I[0, 0],
            "ixy": I[0, 1],
            "ixz": I[0, 2],
            "iyy": I[1, 1],
            "iyz": I[1, 2],
            "izz": I[2, 2],
        }
        entries = " ".join(f'{key}="{value:.17g}"' for key, value in tensor.items())
        lift, twist = (OFFSET[i - 1], TWIST[i - 1]) if i else (0.0, 0.0)
        links += (
            f'<link name="link{i}"><inertial><origin xyz="{numbers(c)}"/><mass value="{m:.17g}"/>'
            f"<inertia {entries}/></inertial></link>"
        )
        joints += (
            f'<joint name="joint{i}" type="continuous"><parent link="{f"link{i - 1}" if i else "base"}"/>'
            f'<child link="link{i}"/><origin xyz="0 0 {lift}" rpy="{twist:.17g} 0 0"/><axis xyz="0 0 1"/></joint>'
        )
    return f'<robot name="arm">{links}{joints}</robot>'


@pytest.fixture(scope="module")
def poor(arm):
    return arm.whitened(300, 0.2, 10.0)


@pytest.fixture(scope="module")
def states():
    rng = np.random.default_rng(8)
    return rng.uniform(-3, 3, (20, 7)), rng.uniform(-1.5, 1.5, (20, 7)), rng.uniform(-4, 4, (20, 7))


@pytest.mark.parametrize("fit", FITS)
def test_mujoco_gives_the_same_torques(arm, poor, states, fit):
    x = FITS[fit](*poor, arm.constraints).x
    model = mujoco.MjModel.from_xml_string(mjcf(x))
    scratch, tau = mujoco.MjData(model), []
    for q, qd, qdd in zip(*states, strict=True):
        scratch.qpos[:], scratch.qvel[:], scratch.qacc[:] = q, qd, qdd
        mujoco.mj_inverse(model, scratch)
        # damping is a passive force in MuJoCo and part of tau here
        tau.append(scratch.qfrc_inverse.copy())
    without_coulomb = x.copy()
    without_coulomb[78::2] = 0.0
    assert np.abs(arm.regressor(*states) @ without_coulomb - tau).max() < 1e-6


@pytest.mark.parametrize("fit", FITS)
def test_pybullet_gives_the_same_torques_without_complaint(arm, poor, states, tmp_path, capfd, fit):
    bullet = pytest.importorskip("pybullet")
    x = FITS[fit](*poor, arm.constraints).x
    file = tmp_path / "arm.urdf"
    file.write_text(urdf(x))
    client = bullet.connect(bullet.DIRECT)
    try:
        capfd.readouterr()
        body = bullet.loadURDF(
            str(file),
            useFixedBase=True,
            flags=bullet.URDF_USE_INERTIA_FROM_FILE,
            physicsClientId=client,
        )
        said = "".join(capfd.readouterr())
        bullet.setGravity(0, 0, -9.81, physicsClientId=client)
        for i in range(7):
            bullet.changeDynamics(
                body, i, linearDamping=0, angularDamping=0, physicsClientId=client
            )
        tau = [
            bullet.calculateInverseDynamics(
                body, list(q), list(qd), list(qdd), physicsClientId=client
            )
            for q, qd, qdd in zip(*states, strict=True)
        ]
    finally:
        bullet.disconnect(client)
    bodies_only = x.copy()
    bodies_only[10:77:11] = bodies_only[77:] = 0.0
    assert "Bad inertia" not in said
    assert np.abs(arm.regressor(*states) @ bodies_only - np.array(tau)).max() < 1e-5


def test_mujoco_refuses_the_least_squares_set(arm, poor):
    shortest = np.linalg.lstsq(*poor, rcond=1e-10)[0]
    with pytest.raises(ValueError):
        mujoco.MjModel.from_xml_string(mjcf(shortest))
