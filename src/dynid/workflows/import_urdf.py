"""A robot file from a URDF: DH table, limits and bodies, checked by forward kinematics."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

from dynid.answer import Answer, picked
from dynid.files.robotfile import robot_text
from dynid.files.urdffile import read_urdf
from dynid.model.from_urdf import import_arm
from dynid.robot import roll_pitch_yaw
from dynid.table import Table
from dynid.workflows.options import ImportOptions

HEAD = """\
Made by dynid import from {urdf}, link {base} to {tip}; joint values are the URDF's.
The frame of {tip} in the last DH frame: xyz {xyz}, rpy {rpy} [m, rad].
Forward kinematics agree with the URDF to {largest:.1e} m and rad.
What the effort column of your logs is, a URDF does not say. Write one of these:
torque: {{source: joint_sensor}}     sensors behind the gears, as on KUKA LWR and iiwa, Franka
torque: {{source: motor_torque}}     from the motors' currents, in N m, as on UR and most industrial arms
torque: {{source: motor_current}}    in A, or in a unit that nobody knows (then with relative: true)"""


def import_urdf(path: Path, options: ImportOptions = ImportOptions()) -> tuple[str, Answer]:
    """Return the text of the robot file that a chain of a URDF describes, and what is worth knowing about it.

    Args:
        path: the URDF.
        options: which chain.

    Raises:
        WrongUrdf: there is no such chain, or it has joints that a DH table cannot describe.
    """
    made = import_arm(
        read_urdf(path),
        read_urdf(path, exact=True),
        **picked(options, "base", "tip", "convention", "name"),
    )
    robot, pose = made.robot, made.tip_pose
    # Position [m] and roll, pitch, yaw [rad] of the tip in the last DH frame, rounding noise taken off.
    rows = (pose[:3, 3].tolist(), roll_pitch_yaw(pose[:3, :3]))
    xyz, rpy = ([round(float(value), 12) + 0.0 for value in row] for row in rows)
    known = picked(made, "base", "tip", "largest")
    head = HEAD.format(urdf=path.name, xyz=xyz, rpy=rpy, **known)
    lengths = {"a_m": "a", "twist_rad": "twist", "d_m": "d", "theta_offset_rad": "theta_offset"}
    bodies = robot.prior.links if robot.prior else ()
    facts = {
        "schema": "dynid/import/1",
        **picked(robot, "convention", robot="name", n_joints="n"),
        **picked(made, "base", "tip", kinematics_largest_difference="largest"),
        "joints": [picked(joint, "type", joint="name", **lengths) for joint in robot.joints],
        "tip_in_last_frame": {"xyz_m": xyz, "rpy_rad": rpy},
        "mass_kg": sum(body.mass for body in bodies) if robot.prior else None,
        "findings": [asdict(finding) for finding in made.findings],
    }
    chain = f"{robot.n} joints from {made.base} to {made.tip}, {robot.convention} DH"
    masses = ", ".join(f"{body.mass:.3g}" for body in bodies)
    answer = Answer(
        facts,
        parts=(
            *made.findings,
            ("robot", f"{robot.name}, {chain}"),
            Table([{head: row[head] for head in [*row][:6]} for row in robot.table()]),
            ("check", f"forward kinematics agree with the URDF to {made.largest:.1e} m and rad"),
            (
                "torque",
                "a URDF does not say what the effort column of a log is; write `torque: {source: ...}` into the file",
            ),
        ),
    )
    if robot.prior:
        prior = ("prior", f"masses {masses} kg, inertias moved into the DH frames")
        answer = replace(answer, parts=(*answer.parts, prior))
    return robot_text(robot, head), answer
