"""The robot file: YAML to ``Robot``, with every mistake named by file and line.

Reads ``robots/*.yaml``, a path, or the files inside the package. Contract of keys: docs/reference/robot-file.md.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal, cast

import numpy as np

from dynid.errors import (
    AngleTooLarge,
    Finding,
    ImplausibleGravity,
    MissingConvention,
    NotYaml,
    RobotNotFound,
    WrongRobotFile,
)
from dynid.files.yamlfile import Value, closest, parse_yaml, read_yaml
from dynid.robot import (
    FRICTION_PARAMETERS,
    Body,
    Controller,
    Coulomb,
    Coupling,
    Cylinders,
    DriverSpec,
    EffectSpec,
    Joint,
    JointMap,
    Known,
    Limits,
    Prior,
    Robot,
    TorqueSource,
    rotation_rpy,
)
from dynid.units import ANGLE, FACTORS

#: DH angles this close to a multiple of 15 degrees are taken to mean it: 1.5708 must not break exact zeros.
SNAP_RAD = 1e-4
SNAP_STEP = math.pi / 12
#: Gravity on Earth lies between 9.76 and 9.84; the band leaves room for rounded values.
GRAVITY_BAND = (9.6, 9.9)
#: Characters of the longest name of a robot or joint.
LONGEST_NAME = 100

DRIVER_KINDS = ("kinova_gen2", "lwr4plus", "generic")
TORQUE_SOURCES = ("joint_sensor", "motor_torque", "motor_current", "gravity_free")
_TOP = (
    "name", "convention", "angle_unit", "gravity", "mount", "base", "joints", "links", "torque", "driver", "simulator",
    "prior", "tool", "coupling", "coulomb", "effects", "known", "controller",
)  # fmt: skip
_JOINT = ("name", "type", "a", "twist", "d", "theta_offset", "limits", "motor_inertia", "friction")


def packaged(folder: str) -> Path:
    """Return the folder ``robots`` or ``trajectories`` that came with dynid."""
    inside = Path(__file__).parents[1] / f"_{folder}"
    return inside if inside.is_dir() else Path(__file__).parents[3] / folder


def known_robots() -> dict[str, Path]:
    """Return the robots in ./robots and inside the package by name; ./robots wins."""
    found: dict[str, Path] = {}
    for folder in (packaged("robots"), Path("robots")):
        for path in sorted(folder.rglob("*.yaml")):
            found[path.relative_to(folder).with_suffix("").as_posix()] = path
    return found


def find_robot(name: str) -> Path:
    """Return the file of a robot given by name or path."""
    if Path(name).is_file():
        return Path(name)
    known = known_robots()
    if name in known:
        return known[name]
    names = ", ".join(sorted(known))
    if name.endswith((".yaml", ".yml")) or "/" in name:
        raise RobotNotFound(f"no robot file '{name}'{closest(name, known)}", where=name, fix=f"known robots: {names}")
    raise RobotNotFound(f"no robot '{name}'{closest(name, known)}", fix=f"known: {names}; or give a path")


def load_robot(name: str | Path) -> Robot:
    """Read a robot by name or path; what was noticed is in ``robot.findings``."""
    path = find_robot(str(name))
    return _robot(read_yaml(path), path)


def parse_robot(text: str, path: Path) -> Robot:
    """Read a robot from the text of its file."""
    return _robot(parse_yaml(text, path), path)


def _robot(root: Value, path: Path) -> Robot:
    if not root.is_mapping:
        raise NotYaml(f"{path} has no keys; it is not a robot file", where=str(path))
    top = root.mapping(_TOP, required=("name", "joints"))
    if "convention" not in top:
        raise MissingConvention(
            f"{path}: say which DH convention: standard or modified; they give different robots", where=str(path)
        )
    unit = top["angle_unit"].choice(tuple(ANGLE)) if "angle_unit" in top else "rad"
    findings: list[Finding] = []
    joints = tuple(_joint(value, unit, i, findings) for i, value in enumerate(top["joints"].items()))
    if not joints:
        raise WrongRobotFile(f"{top['joints'].where}: joints is empty", where=top["joints"].where)
    _unique(joints, top["joints"])
    n = len(joints)
    base_xyz, base_rpy = _base(top.get("base"), unit)
    gravity = _gravity(top.get("gravity"), top.get("mount"), base_rpy, findings)
    return Robot(
        name=_name(top["name"]),
        convention=cast(Literal["standard", "modified"], top["convention"].choice(("standard", "modified"))),
        joints=joints,
        gravity=gravity,
        base_xyz=base_xyz,
        base_rpy=base_rpy,
        links=_links(top.get("links"), n),
        torque=_torque(top.get("torque"), n),
        driver=_driver(top["driver"], unit, joints) if "driver" in top else None,
        simulator=_joint_map(top["simulator"].mapping(("sign", "offset")), unit, joints)
        if "simulator" in top
        else None,
        prior=_prior(top["prior"], n) if "prior" in top else None,
        tool=_body(top["tool"]) if "tool" in top and not top["tool"].is_null else None,
        coupling=_coupling(top["coupling"], n) if "coupling" in top and not top["coupling"].is_null else None,
        coulomb=_coulomb(top["coulomb"], unit, joints) if "coulomb" in top else None,
        effects=tuple(_effect(value, joints) for value in top["effects"].items()) if "effects" in top else (),
        known=_known(top["known"], n) if "known" in top else Known(),
        controller=_controller(top["controller"], n) if "controller" in top else None,
        path=path,
        findings=tuple(findings),
    )


def _joint(value: Value, unit: str, index: int, findings: list[Finding]) -> Joint:
    keys = value.mapping(_JOINT)
    kind = keys["type"].choice(("revolute", "prismatic")) if "type" in keys else "revolute"
    friction = Joint.friction
    if "friction" in keys:
        friction = tuple(item.choice(tuple(FRICTION_PARAMETERS)) for item in keys["friction"].items())
    length = {key: keys[key].number() if key in keys else 0.0 for key in ("a", "d")}
    turn = {key: _dh_angle(keys[key], unit, findings) if key in keys else 0.0 for key in ("twist", "theta_offset")}
    return Joint(
        name=_name(keys["name"]) if "name" in keys else f"joint_{index + 1}",
        type=cast(Literal["revolute", "prismatic"], kind),
        a=length["a"],
        twist=turn["twist"],
        d=length["d"],
        theta_offset=turn["theta_offset"],
        limits=_limits(keys["limits"], unit if kind == "revolute" else "") if "limits" in keys else Limits(),
        motor_inertia=keys["motor_inertia"].flag() if "motor_inertia" in keys else True,
        friction=friction,
    )


def _dh_angle(value: Value, unit: str, findings: list[Finding]) -> float:
    """Read a DH angle; refuse more than a full turn, snap near-misses such as 1.5708 and say so."""
    angle = value.angle(unit)
    if abs(angle) > 2 * math.pi + 1e-9:
        raise AngleTooLarge(
            f"{value.where}: {value.path} = {value.text()} {unit} is more than a full turn", where=value.where
        )
    nearest = round(angle / SNAP_STEP) * SNAP_STEP
    miss = abs(angle - nearest)
    if 1e-9 < miss < SNAP_RAD:
        findings.append(
            Finding(
                "W202",
                "warning",
                f"{value.where}: {value.path} = {value.text()} is {miss:.1e} rad from {math.degrees(nearest):g} deg; "
                f"{math.degrees(nearest):g} deg is used (write `{math.degrees(nearest):g} deg` to silence this)",
                {"given_rad": angle, "used_rad": nearest},
            )
        )
    return nearest if miss < SNAP_RAD else angle


def _limits(value: Value, unit: str) -> Limits:
    """Read limits; ``unit`` is empty for a prismatic joint, whose limits are in metres."""
    keys = value.mapping(("position", "velocity", "acceleration", "torque"))

    def read(item: Value) -> float:
        return item.angle(unit) if unit else item.number()

    position: tuple[float, float] | None = None
    if "position" in keys and not keys["position"].is_null:
        lower, upper = (read(item) for item in keys["position"].items(2))
        if lower >= upper:
            where = keys["position"].where
            raise WrongRobotFile(
                f"{where}: {keys['position'].path}: lower limit {lower:g} is not below upper {upper:g}", where=where
            )
        position = (lower, upper)
    sizes: dict[str, float | None] = {"velocity": None, "acceleration": None, "torque": None}
    for key in sizes:
        if key in keys and not keys[key].is_null:
            size = keys[key].number() if key == "torque" else read(keys[key])
            if size <= 0:
                raise WrongRobotFile(
                    f"{keys[key].where}: {keys[key].path} = {size:g} must be positive", where=keys[key].where
                )
            sizes[key] = size
    return Limits(position, **sizes)


def _name(value: Value) -> str:
    """Return a name that a page can show and a simulator can hold: PyBullet ends the process on others."""
    name = value.text()
    if not 1 <= len(name) <= LONGEST_NAME:
        what = f"{value.where}: {value.path} has {len(name)} characters; a name has 1 to {LONGEST_NAME}"
        raise WrongRobotFile(what, where=value.where)
    return name


def _unique(joints: tuple[Joint, ...], value: Value) -> None:
    names = [joint.name for joint in joints]
    for name in names:
        if names.count(name) > 1:
            raise WrongRobotFile(f"{value.where}: two joints are called '{name}'", where=value.where)


def _base(value: Value | None, unit: str) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    keys = value.mapping(("xyz", "rpy")) if value else {}
    xyz = _three(keys["xyz"]) if "xyz" in keys else (0.0, 0.0, 0.0)
    r, p, y = (item.angle(unit) for item in keys["rpy"].items(3)) if "rpy" in keys else (0.0, 0.0, 0.0)
    return xyz, (r, p, y)


def _three(value: Value) -> tuple[float, float, float]:
    x, y, z = (item.number() for item in value.items(3))
    return x, y, z


def _gravity(
    value: Value | None, mount: Value | None, rpy: tuple[float, float, float], findings: list[Finding]
) -> tuple[float, float, float]:
    how = mount.choice(("floor", "wall", "ceiling")) if mount else "floor"
    if value is None:
        return (0.0, 0.0, 9.81) if how == "ceiling" else (0.0, 0.0, -9.81)
    gravity = _three(value)
    size = math.hypot(*gravity)
    if size and not GRAVITY_BAND[0] <= size <= GRAVITY_BAND[1]:
        hint = "; cm?" if 960 <= size <= 990 else "; in g?" if 0.9 <= size <= 1.1 else ""
        shown = ", ".join(f"{g:g}" for g in gravity)
        raise ImplausibleGravity(f"{value.where}: gravity is ({shown}): {size:g} m/s^2{hint}", where=value.where)
    world = rotation_rpy(rpy) @ np.array(gravity)
    if size and world[2] > 0.5 * size and how == "floor":
        findings.append(
            Finding(
                "W206",
                "warning",
                f"{value.where}: gravity points up in the world frame (base.rpy taken into account): "
                "a ceiling mount? say `mount: ceiling`",
                {"gravity_world": world.tolist()},
            )
        )
    return gravity


def _links(value: Value | None, n: int) -> tuple[int, ...]:
    if value is None or (not value.is_list and value.text() == "all"):
        return ()
    numbers = tuple(item.integer() for item in value.items())
    for number in numbers:
        if not 1 <= number <= n:
            raise WrongRobotFile(f"{value.where}: links: there is no link {number}, the arm has {n}", where=value.where)
    return tuple(sorted(set(numbers)))


def _torque(value: Value | None, n: int) -> TorqueSource:
    if value is None:
        return TorqueSource()
    if not value.is_mapping:
        return TorqueSource(value.choice(TORQUE_SOURCES))
    keys = value.mapping(("source", "gain", "relative", "noise"))
    relative = "relative" in keys and keys["relative"].flag()
    source = keys["source"].choice(TORQUE_SOURCES) if "source" in keys else "joint_sensor"
    noise = _positive(keys["noise"], n, "it is a standard deviation in N m") if "noise" in keys else None
    measured = None if noise is None else tuple(float(x) for x in noise if x is not None)
    if measured is not None and len(measured) < n:
        raise WrongRobotFile(f"{keys['noise'].where}: torque.noise: a joint has none", where=keys["noise"].where)
    if "gain" not in keys or keys["gain"].is_null:
        return TorqueSource(source, noise=measured)
    gains = _positive(keys["gain"], n, "reverse a current with `sign:` under `driver:`")
    return TorqueSource(source, gains, relative, measured)


def _positive(value: Value, n: int, fix: str) -> tuple[float | None, ...]:
    """Return one positive number a joint, given as a list or as one for all; None where null is written."""
    entries = value.items(n) if value.is_list else [value] * n
    numbers = tuple(None if item.is_null else item.number() for item in entries)
    for item, number in zip(entries, numbers, strict=True):
        if number is not None and number <= 0:
            raise WrongRobotFile(f"{item.where}: {item.path} = {number:g} must be positive", where=item.where, fix=fix)
    return numbers


def _driver(value: Value, unit: str, joints: tuple[Joint, ...]) -> DriverSpec:
    keys = value.mapping(("kind", "topic", "joint_names", "sign", "offset", "units"), required=("kind",))
    names: tuple[str, ...] = ()
    if "joint_names" in keys:
        names = tuple(item.text() for item in keys["joint_names"].items(len(joints)))
    units = {"position": "rad", "velocity": "rad/s", "effort": "Nm"}
    if "units" in keys:
        given = keys["units"].mapping(tuple(units))
        units |= {key: item.choice(tuple(FACTORS[key])) for key, item in given.items()}
    return DriverSpec(
        kind=keys["kind"].choice(DRIVER_KINDS),
        topic=keys["topic"].text() if "topic" in keys and not keys["topic"].is_null else None,
        joint_names=names,
        map=_joint_map(keys, unit, joints),
        units=units,
    )


def _joint_map(keys: dict[str, Value], unit: str, joints: tuple[Joint, ...]) -> JointMap:
    n = len(joints)
    sign = tuple(item.number() for item in keys["sign"].items(n)) if "sign" in keys else (1.0,) * n
    for value in sign:
        if value not in (1.0, -1.0):
            raise WrongRobotFile(
                f"{keys['sign'].where}: {keys['sign'].path} entries are 1 or -1, not {value:g}",
                where=keys["sign"].where,
            )
    offset = (0.0,) * n
    if "offset" in keys:
        pairs = zip(keys["offset"].items(n), joints, strict=True)
        offset = tuple(item.angle(unit) if joint.revolute else item.number() for item, joint in pairs)
    return JointMap(sign, offset)


def _body(value: Value) -> Body:
    keys = value.mapping(("mass", "com", "inertia_com"), required=("mass",))
    mass = keys["mass"].number()
    if mass < 0:
        raise WrongRobotFile(
            f"{keys['mass'].where}: {keys['mass'].path} = {mass:g} kg is negative", where=keys["mass"].where
        )
    com = _three(keys["com"]) if "com" in keys else (0.0, 0.0, 0.0)
    if "inertia_com" not in keys:
        return Body(mass, com)
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    entries = keys["inertia_com"].mapping(names)
    xx, xy, xz, yy, yz, zz = (entries[name].number() if name in entries else 0.0 for name in names)
    return Body(mass, com, (xx, xy, xz, yy, yz, zz))


def _prior(value: Value, n: int) -> Prior:
    keys = value.mapping(("cylinders", "links"))
    if len(keys) != 1:
        raise WrongRobotFile(f"{value.where}: prior needs one of cylinders, links", where=value.where)
    if "links" in keys:
        return Prior(links=tuple(_body(item) for item in keys["links"].items(n)))
    inner = keys["cylinders"].mapping(("density", "radius", "mass"))
    numbers = {key: item.number() for key, item in inner.items()}
    for key, number in numbers.items():
        if number <= 0:
            raise WrongRobotFile(
                f"{inner[key].where}: {inner[key].path} = {number:g} must be positive", where=inner[key].where
            )
    if ("density" in numbers) == ("mass" in numbers):
        raise WrongRobotFile(f"{value.where}: prior.cylinders needs one of density, mass", where=value.where)
    return Prior(cylinders=Cylinders(**numbers))


def read_prior(path: Path, n: int) -> Prior:
    """Read a prior from a file of its own that holds what stands under `prior:` of a robot file."""
    return _prior(read_yaml(path), n)


def _known(value: Value, n: int) -> Known:
    """Read bounds on masses and centres of mass, by link number."""
    keys, numbers = value.mapping(("total_mass", "link_mass", "com_box")), [str(k) for k in range(1, n + 1)]

    def by_link(key: str) -> list[tuple[int, Value]]:
        return [(int(k), item) for k, item in keys[key].mapping(numbers).items()] if key in keys else []

    return Known(
        total_mass=_bounds(keys["total_mass"]) if "total_mass" in keys else None,
        link_mass=tuple((k, _bounds(item)) for k, item in by_link("link_mass")),
        com_box=tuple((k, _box(item)) for k, item in by_link("com_box")),
    )


def _bounds(value: Value) -> tuple[float, float]:
    low, high = (item.number() for item in value.items(2))
    if not 0 <= low < high:
        raise WrongRobotFile(f"{value.where}: {value.path}: {low:g}, {high:g} is no range of masses", where=value.where)
    return low, high


def _box(value: Value) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    low, high = (_three(item) for item in value.items(2))
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise WrongRobotFile(f"{value.where}: {value.path}: the first corner must be the lower one", where=value.where)
    return low, high


def _coupling(value: Value, n: int) -> Coupling:
    """Read reductions and a coupling matrix; a matrix whose diagonal is the reductions holds them already."""
    keys = value.mapping(("reduction", "matrix"))
    reduction = np.array([item.number() for item in keys["reduction"].items(n)]) if "reduction" in keys else np.ones(n)
    matrix = np.eye(n)
    if "matrix" in keys:
        matrix = np.array([[item.number() for item in row.items(n)] for row in keys["matrix"].items(n)])
    if "reduction" in keys and not np.allclose(np.diag(matrix), reduction):
        matrix = reduction[:, None] * matrix
    if abs(np.linalg.det(matrix / np.abs(matrix).max())) < 1e-12:
        raise WrongRobotFile(f"{value.where}: the coupling matrix cannot be inverted", where=value.where)
    return Coupling(tuple(tuple(row) for row in matrix.tolist()))


def _coulomb(value: Value, unit: str, joints: tuple[Joint, ...]) -> Coulomb:
    """Read the shape of the Coulomb sign; velocities are in angle_unit per second for turning joints."""
    keys = value.mapping(("shape", "velocity"), required=("velocity",))
    shape = keys["shape"].choice(("smooth", "threshold")) if "shape" in keys else "smooth"
    entry = keys["velocity"]
    values = entry.items(len(joints)) if entry.is_list else [entry] * len(joints)
    velocity = tuple(v.angle(unit) if j.revolute else v.number() for v, j in zip(values, joints, strict=True))
    if min(velocity) <= 0:
        raise WrongRobotFile(f"{entry.where}: {entry.path} must be positive", where=entry.where)
    return Coulomb(shape, velocity)


def _controller(value: Value, n: int) -> Controller:
    """Read the gains of the position controller, one or a list each."""
    keys = value.mapping(("kp", "kd"), required=("kp", "kd"))
    gains: list[tuple[float, ...]] = []
    for key in ("kp", "kd"):
        items = keys[key].items(n) if keys[key].is_list else [keys[key]] * n
        gains.append(tuple(item.number() for item in items))
        if min(gains[-1]) < 0:
            raise WrongRobotFile(f"{keys[key].where}: {keys[key].path} is negative", where=keys[key].where)
    return Controller(*gains)


def _effect(value: Value, joints: tuple[Joint, ...]) -> EffectSpec:
    keys = value.mapping(("effect", "joints", "parameters", "std_error"), required=("effect", "joints"))
    names = tuple(joint.name for joint in joints)
    acting = tuple(item.choice(names) for item in keys["joints"].items())
    parameters: dict[str, dict[str, float]] = {"parameters": {}, "std_error": {}}
    for key, target in parameters.items():
        if key in keys:
            inner = keys[key]
            for name in [str(k.value) for k, _ in inner.node.value] if inner.is_mapping else []:
                target[name] = inner.mapping([str(k.value) for k, _ in inner.node.value])[name].number()
    return EffectSpec(keys["effect"].text(), acting, parameters["parameters"], parameters["std_error"])
