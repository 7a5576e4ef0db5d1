"""The catalogue: every effect by its identifier, in the order in which equally good ones are preferred."""

from __future__ import annotations

import copyreg
from dataclasses import replace

import numpy as np

from dynid.model import tuning
from dynid.model.effects import laws
from dynid.model.effects.friction import sign_of
from dynid.model.effects.interface import Effect
from dynid.model.effects.motion import Shapes
from dynid.model.kinematics import link_frames, tip_jacobian


def _each(name: str, *values: float) -> Shapes:
    return [{name: value} for value in values]


_JOINT_MORE = "a link that moves against its motor is one more joint of a simulator"

_ALL = (
    Effect(
        name="torque_offset",
        more_of="fo",
        title="torque offset, or Coulomb friction that differs with the direction",
        equation="c",
        signature="constant, independent of the motion",
        separate="a wide range; a rest pose approached from both sides separates an offset from "
        "one-sided friction",
        forms=("1",),
        units={"c": "N m"},
    ),
    Effect(
        name="viscous",
        more_of="fv",
        title="viscous friction",
        equation="fv qd",
        signature="proportional to the joint's own speed",
        separate="several speeds, both ways",
        forms=("qd",),
        units={"fv": "N m s/rad"},
    ),
    Effect(
        name="coulomb",
        more_of="fc",
        title="Coulomb friction",
        equation="fc sign(qd)",
        signature="a step at each reversal, the same size both ways",
        separate="several reversals at different speeds",
        forms=("sign(qd)",),
        units={"fc": "N m"},
    ),
    Effect(
        name="asymmetric_viscous",
        title="viscous friction that differs with the direction",
        equation="a |qd|",
        signature="grows with speed, with the same sign both ways: largest where the joint is "
        "fast, small where it is slow",
        separate="drive the same path forwards and backwards",
        forms=("|qd|",),
        units={"a": "N m s/rad"},
    ),
    Effect(
        name="stribeck",
        title="Stribeck friction",
        equation="a exp(-(|qd| / vs)^d) sign(qd), a > 0",
        signature="a hump at low speed on both sides of each reversal that is gone at high speed",
        separate="sweeps at constant speed over two decades, down to a tenth of vs",
        forms=("exp(-(|qd| / {vs})^{d}) sign(qd)",),
        positive=True,
        shape_units={"vs": "rad/s", "d": ""},
        steps={"vs": ("times", 1.25), "d": ("times", 1.3)},
        shapes=[
            {"vs": vs, "d": d}
            for vs in (0.014, 0.022, 0.036, 0.06, 0.1, 0.16)
            for d in (0.7, 1.0, 2.0)
        ],
        units={"a": "N m"},
    ),
    Effect(
        name="nonlinear_viscous",
        title="friction that is not linear in speed",
        equation="a sign(qd) |qd|^p",
        signature="the residual bends with speed: one sign at middle speeds, the other at the "
        "highest",
        separate="move the joint at least five times faster than the bend",
        forms=("sign(1 qd) |qd|^{p}",),
        shape_units={"p": ""},
        steps={"p": ("times", 1.1)},
        shapes=_each("p", 0.3, 0.5, 0.7, 1.3, 1.6, 2.0, 2.5, 3.0),
        units={"a": "N m (s/rad)^p"},
    ),
    Effect(
        name="load_friction",
        title="friction that grows with the load",
        equation="a |tau_rb| sign(qd), a > 0",
        signature="Coulomb-like, but larger where the joint carries more: high at high load, low "
        "at low load",
        separate="the same motion with and without a payload",
        forms=("|tau| sign(qd)",),
        positive=True,
        needs_model=True,
        units={"a": ""},
    ),
    Effect(
        name="torque_gain",
        title="gain error of one joint's torque sensor",
        equation="g tau",
        signature="proportional to the joint's own torque, and in the joints whose model shares "
        "its parameters",
        separate="a known payload, or a second sensor; a gain common to all joints does not show "
        "without one",
        forms=("total",),
        needs_model=True,
        units={"g": ""},
    ),
    Effect(
        name="torque_constant",
        title="torque constant that changes with speed",
        equation="c |qd| tau",
        signature="proportional to the joint's own torque where it is fast, nothing where it is "
        "slow",
        separate="the same load carried slowly and fast, with and against gravity",
        forms=("|qd| total",),
        needs_model=True,
        units={"c": "s/rad"},
    ),
    Effect(
        name="warmup_friction",
        title="friction that falls while the drive warms up",
        equation="exp(-t / tw) (a1 sign(qd) + a2 qd)",
        signature="friction is larger in the first minutes than later",
        separate="repeat the same motion cold and warm",
        forms=("exp(-t / {tw}) sign(qd)", "exp(-t / {tw}) qd"),
        shape_units={"tw": "s"},
        steps={"tw": ("times", 1.4)},
        shapes=_each("tw", 12.0, 25.0, 50.0, 100.0, 250.0),
        units={"a1": "N m", "a2": "N m s/rad"},
    ),
    Effect(
        name="torque_drift",
        title="drift of the torque sensor",
        equation="a tc (1 - exp(-t / tc)); a t for a long tc",
        signature="the mean of the residual changes with time and with nothing else",
        separate="repeat the same motion minutes apart",
        forms=("{tc} (1 - exp(-t / {tc}))",),
        shape_units={"tc": "s"},
        steps={"tc": ("times", 1.4)},
        shapes=_each("tc", 1000000.0, 10.0, 25.0, 60.0, 150.0),
        units={"a": "N m/s"},
    ),
    Effect(
        name="offset_step",
        left_out="it happened once, at a time of the log",
        title="torque offset that jumps once and stays",
        equation="c after the time `since`",
        signature="the mean of the residual jumps at one time, and stays where it is",
        separate="zero the torque sensors and record again",
        # A ramp of 50 ms: the low-pass filter of the torques knows no faster one.
        forms=("10 (|t - {since} + 0.025| - |t - {since} - 0.025|) + 0.5",),
        shapes_of=laws.step_times,
        shape_units={"since": "s"},
        steps={"since": ("plus", 0.5)},
        units={"c": "N m"},
    ),
    Effect(
        name="position_friction",
        title="friction that varies with the position",
        equation="(a cos(h q) + b sin(h q)) sign(qd)",
        signature="friction depends on the position of the joint, equally both ways",
        separate="cross the whole range both ways at one slow speed",
        forms=("cos({h} q) sign(qd)", "sin({h} q) sign(qd)"),
        shape_units={"h": "1/rad"},
        shapes=_each("h", 0.5, 1.0, 1.5, 2.0, 2.5),
        steps={"h": ("plus", 0.25)},
        units={"a": "N m", "b": "N m"},
    ),
    Effect(
        name="gear_friction",
        title="friction that varies with the angle of a gear wheel",
        equation="(a cos(k q) + b sin(k q)) sign(qd)",
        signature="a wave over the joint's position that changes sign with the direction",
        separate="a slow, even motion over several waves, both ways: a ripple keeps its sign, "
        "this does not",
        forms=("cos({k} q) sign(qd)", "sin({k} q) sign(qd)"),
        shapes_of=lambda m, j: laws.wave_shapes(m, j, tuning.FASTEST_FRICTION_WAVE),
        shape_units={"k": "1/rad"},
        steps={"k": ("plus", 0.2)},
        units={"a": "N m", "b": "N m"},
    ),
    Effect(
        name="torque_ripple",
        title="torque ripple (cogging, gear, sensor)",
        equation="a cos(k q) + b sin(k q)",
        signature="a wave over the joint's position, faster in time when the joint is faster",
        separate="a slow, even motion over several waves",
        forms=("cos({k} q)", "sin({k} q)"),
        shapes_of=laws.wave_shapes,
        shape_units={"k": "1/rad"},
        steps={"k": ("plus", 0.1)},
        units={"a": "N m", "b": "N m"},
    ),
    Effect(
        name="spring",
        title="spring or cable torque",
        equation="k1 q (+ k2 q^2 + k3 q^3) + c",
        signature="rises over the joint's range: one sign at one end, the other at the other end",
        separate="dwell at both ends of the range",
        forms_of=laws.spring_forms,
        units_of=laws.spring_units,
        shapes_of=laws.spring_shapes,
        shape_units={"order": "", "constant": ""},
    ),
    Effect(
        name="counterbalance",
        title="counterbalance (spring or cylinder)",
        equation="a sin(q) + b cos(q)",
        signature="one wave over a whole turn of the joint, whatever the pose of the other joints; "
        "carries weight that no link has",
        separate="turn the joint through its whole range with the arm folded and stretched, "
        "which changes gravity alone",
        forms=("sin(q)", "cos(q)"),
        shapes_of=lambda m, j: [{}] if m.robot.joints[j].revolute else [],
        uses=("arm",),
        units={"a": "N m", "b": "N m"},
    ),
    Effect(
        name="end_stop",
        title="one-sided stop or cable that snags",
        equation="a max(0, side (q - q1))",
        signature="only at one end of the joint's range, the same both ways",
        separate="pass q1 often and from both sides",
        # Why so: it is max(0, x) without another function.
        forms=("0.5 (({side}) (q - ({q1})) + |({side}) (q - ({q1}))|)",),
        shapes_of=laws.end_shapes,
        shape_units={"side": "", "q1": "rad"},
        steps={"q1": ("plus", 0.1)},
        units={"a": "N m/rad"},
    ),
    Effect(
        name="motor_inertia",
        more_of="Im",
        title="rotor inertia",
        equation="Im qdd",
        signature="proportional to the joint's own acceleration; strongest at reversals of a fast "
        "joint",
        separate="fast reversals; on the first joints it cannot be separated from the link's "
        "own inertia",
        forms=("qdd",),
        positive=True,
        units={"Im": "kg m^2"},
    ),
    Effect(
        name="joint_coupling",
        title="friction that a neighbouring joint drags along",
        equation="a qd_k + b sign(qd_k), k the neighbour",
        signature="the residual of one joint follows the speed of the next one",
        separate="move the two joints one after the other",
        forms=("qd", "sign(qd)"),
        neighbours=True,
        scope="pair",
        units={"a": "N m s/rad", "b": "N m"},
    ),
    Effect(
        name="torque_crosstalk",
        title="cross-talk from another joint's torque",
        equation="a tau_rb,k + b tau_f,k, k another joint, tau_f its friction",
        signature="the residual of one joint follows the load of another",
        separate="load one joint while the other rests",
        forms=("tau", "total - tau"),
        scope="pair",
        needs_model=True,
        units={"a": "", "b": ""},
    ),
    Effect(
        name="joint_elasticity",
        left_out=_JOINT_MORE,
        title="elastic joint with the encoder on the motor's side",
        equation="tau_rb(q - tau_j / K e_j) - tau_rb(q), 1/K > 0",
        signature="at high frequency and where the torque changes fast; in several joints at once",
        separate="fast reversals under load",
        law=laws.elasticity,
        spreads=True,
        sized="compliance",
        positive=True,
        needs_model=True,
        units={"compliance": "rad/N m"},
    ),
    Effect(
        name="backlash",
        left_out=_JOINT_MORE,
        title="backlash of a gear with the encoder on the motor's side",
        equation="-a tau_rb while the link crosses the gap 2 b on its own, then the jolt that it "
        "lands with; a near 1",
        signature="where the load of the joint changes sign: no torque for a moment, then a "
        "jolt, in several joints",
        separate="let the load change sign often, slowly and fast; elasticity follows the size "
        "of the torque instead",
        many=laws.backlashes,
        spreads=True,
        positive=True,
        needs_model=True,
        shape_units={"b": "rad"},
        steps={"b": ("times", 1.5)},
        shapes=_each("b", 0.00025, 0.0005, 0.001, 0.002, 0.004, 0.008),
        units={"a": ""},
    ),
    Effect(
        name="encoder_offset",
        title="encoder zero that is off",
        equation="tau_rb(q - D e_j) - tau_rb(q)",
        signature="in several joints at once, with the pattern of gravity turned by a small angle",
        separate="static poses over the whole workspace",
        law=laws.encoder_offset,
        spreads=True,
        sized="offset",
        needs_model=True,
        units={"offset": "rad"},
    ),
    Effect(
        name="presliding_hysteresis",
        title="hysteresis before sliding (Dahl)",
        equation="a (z - sign(qd)), dz/dq = (1 - z sign(qd)) / delta, a > 0",
        signature="friction builds up over the first millirads after each reversal instead of "
        "jumping",
        separate="many small reversals, each a few delta long",
        forms=("z - sign(qd)",),
        law=lambda m, j, s: [laws.presliding(m.q[:, j[0]], s["delta"]) - sign_of(m, j[0])],
        positive=True,
        shape_units={"delta": "rad"},
        steps={"delta": ("times", 1.4)},
        shapes=_each("delta", *np.geomspace(0.002, 0.2, 9).tolist()),
        units={"a": "N m"},
    ),
    Effect(
        name="base_tilt",
        title="base that is not level",
        equation="x tau_g(e1) + y tau_g(e2), e1 and e2 the axes of frame 0 that are most level, and "
        "c cos(q1) + s sin(q1) on joint 1",
        signature="gravity acts on the first joint, and turned by a small angle on the others",
        separate="turn the first joint through its whole range with the arm stretched out",
        law=laws.base_tilt,
        scope="arm",
        needs_model=True,
        units={"x": "rad", "y": "rad", "c": "N m", "s": "N m"},
    ),
    Effect(
        name="torque_delay",
        left_out="it is a delay of the log, not a torque of the arm",
        title="delay of the torque behind the position",
        equation="-T d tau/dt, the logs are then shifted by T",
        signature="in all joints alike, where the torque changes fast: reversals, high frequency",
        separate="fast reversals; look for a filter in the driver",
        law=lambda m, j, s: -np.gradient(m.total, m.t, axis=0).T[None],
        scope="arm",
        needs_model=True,
        units={"delay": "s"},
    ),
    Effect(
        name="tool_force",
        title="constant force on the tool (a hose, a cable)",
        equation="-J^T f, f constant in the world",
        signature="wrist and elbow together, with the pattern of a force at the tip",
        separate="turn the wrist in many directions at each pose",
        law=lambda m, j, s: -tip_jacobian(m.robot, link_frames(m.robot, m.q)).T,
        scope="arm",
        units={"x": "N", "y": "N", "z": "N"},
    ),
    Effect(
        name="payload",
        more_of="body",
        title="payload that the model does not know",
        equation="ten parameters of the last link, the first `form` of them",
        signature="proportional to gravity, joints 2 and 4 first",
        separate="any motion",
        law=laws.payload,
        units_of=laws.payload_units,
        scope="arm",
        uses=("frozen",),
        shape_units={"form": ""},
        shapes=_each("form", 1.0, 4.0, 10.0),
    ),
    Effect(
        name="coulomb_change",
        more_of="fc",
        title="changed Coulomb friction",
        equation="c sign(qd)",
        signature="a step at each reversal, on one joint",
        separate="any motion with reversals",
        forms=("sign(qd)",),
        uses=("frozen",),
        units={"c": "N m"},
    ),
    Effect(
        name="viscous_change",
        more_of="fv",
        title="changed viscous friction",
        equation="v qd",
        signature="proportional to the speed of one joint",
        separate="several speeds, both ways",
        forms=("qd",),
        uses=("frozen",),
        units={"v": "N m s/rad"},
    ),
)
CATALOGUE: dict[str, Effect] = {effect.name: effect for effect in _ALL}


def _restored(name: str, at: float) -> Effect:
    return replace(CATALOGUE[name], at=at) if at else CATALOGUE[name]


copyreg.pickle(Effect, lambda effect: (_restored, (effect.name, effect.at)))
