"""What the workflows may be told: their options, which the command line, configuration files and notebooks share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Any, Literal

from dynid.errors import WrongUsage
from dynid.log import Log
from dynid.options import MOST, LogOptions, Options, option, share
from dynid.robot import EffectSpec, Prior
from dynid.text import whole_number

#: Columns that each joint may have beyond its link's ten parameters.
EFFECTS = ("viscous", "coulomb", "offset", "motor_inertia")


def _vector(value: Any, name: str) -> tuple[float, float, float] | None:  # noqa: ANN401
    if value is None:
        return None
    try:
        x, y, z = (float(part) for part in (value.split(",") if isinstance(value, str) else value))
    except (TypeError, ValueError):
        raise WrongUsage(
            f"{name} '{value}' must be three numbers", fix=f"{name} 0,0,-9.81"
        ) from None
    return x, y, z


def _effects(value: Any, name: str) -> tuple[str, ...] | None:  # noqa: ANN401
    if value is None:
        return None
    words = value.split(",") if isinstance(value, str) else value
    wanted = () if value == "none" else tuple(word.strip() for word in words)
    for word in wanted:
        if word not in EFFECTS:
            raise WrongUsage(
                f"{name}: no effect '{word}'", fix=f"choose from {', '.join(EFFECTS)}, or none"
            )
    return wanted


def _tolerance(value: Any, name: str) -> float | None:  # noqa: ANN401
    if value is None or value == "auto":
        return None
    try:
        return float(value)
    except (TypeError, ValueError):
        raise WrongUsage(f"{name} '{value}' must be auto or a number", fix=f"{name} auto") from None


def _samples(value: Any, name: str) -> int:  # noqa: ANN401
    if not 10 <= int(value) <= 100_000:
        raise WrongUsage(
            f"{name} {value} must lie between 10 and 100000", fix=f"such as {name} 200"
        )
    return int(value)


def _links(value: Any, name: str) -> str | tuple[int, ...] | None:  # noqa: ANN401
    if value is None or isinstance(value, str):
        return value
    found = tuple(value)
    if not all(isinstance(link, Integral) for link in found):
        raise WrongUsage(f"{name} {value!r:.60} is not a list of links", fix=f"such as {name} 1-7")
    return tuple(int(link) for link in found)


@dataclass(frozen=True)
class ModelOptions(Options):
    """What differs from the robot file, and how the base parameters are found."""

    gravity: tuple[float, float, float] | None = option(
        None,
        "Gravity in frame 0 [m/s^2], instead of the robot file's.",
        metavar="X,Y,Z",
        read=_vector,
    )
    effects: tuple[str, ...] | None = option(
        None,
        f"Columns of every joint: some of {','.join(EFFECTS)}; or none.",
        metavar="LIST",
        read=_effects,
    )
    links: str | tuple[int, ...] | None = option(
        None,
        "Links to identify, such as 1-7 or 4,5,6; the others keep the prior.",
        metavar="LIST",
        read=_links,
    )
    samples: int = option(
        200,
        "Number of random states at which singular values are computed.",
        bounds=(10, 100_000),
        read=_samples,
        shown="",
    )
    tolerance: float | None = option(
        None,
        "Relative singular value below which columns count as dependent.",
        metavar="auto|X",
        read=_tolerance,
        shown="auto",
    )


METHODS = ("auto", "wls", "ols", "irls", "iv", "ridge")


def _holdout(value: Any, name: str) -> Any:  # noqa: ANN401
    """Return a share, ``auto``, None for ``none``, or a log (its path until it is read)."""
    if value is None or value == "none":
        return None
    if value == "auto":
        return "auto"
    if isinstance(value, (Log, Path)):
        return value
    if not isinstance(value, (str, float)):
        raise TypeError("it is neither a share nor a log")
    text = str(value)
    digits = text.removesuffix("%").replace(".", "", 1)
    return share(value, name) if digits.isdigit() else Path(text)


Range = tuple[float, float]


Corner = tuple[float, float, float]


#: What each option is given.
SUCH_AS = {
    "--total-mass": "15:17",
    "--link-mass": "2=3.5:4.5",
    "--com-box": "7=-0.1,-0.1,0:0.1,0.1,0.2",
}


def _range(value: Any, name: str) -> Range | None:  # noqa: ANN401
    if value is None:
        return None
    low, high = (
        _two(value, name, 1) if isinstance(value, str) else ((float(value[0]),), (float(value[1]),))
    )
    if not low[0] < high[0]:
        raise WrongUsage(f"{name} '{value}': the first number must be the smaller one")
    return low[0], high[0]


def _ranges(value: Any, name: str) -> tuple[tuple[int, Range], ...]:  # noqa: ANN401
    found = []
    for item in value:
        link, rest = _link(item, name)
        bounds = _range(rest, name)
        assert bounds is not None
        found.append((link, bounds))
    return tuple(found)


def _boxes(value: Any, name: str) -> tuple[tuple[int, tuple[Corner, Corner]], ...]:  # noqa: ANN401
    found = []
    for item in value:
        link, rest = _link(item, name)
        low, high = _two(rest, name, 3) if isinstance(rest, str) else rest
        (a, b, c), (x, y, z) = low, high
        if not (a < x and b < y and c < z):
            raise WrongUsage(f"{name} '{rest}': the first corner must be the lower one")
        found.append((link, ((a, b, c), (x, y, z))))
    return tuple(found)


def _link(item: Any, name: str) -> tuple[int, Any]:  # noqa: ANN401
    if not isinstance(item, str):
        return int(item[0]), item[1]
    number, equals, rest = item.partition("=")
    if not equals or whole_number(number.strip()) < 1:
        raise WrongUsage(f"{name} '{item}' does not begin with LINK=, the number of a link")
    return int(number), rest


def _two(text: str, name: str, count: int) -> tuple[Sequence[float], Sequence[float]]:
    try:
        parts = [[float(word) for word in part.split(",")] for part in text.split(":")]
    except ValueError:
        parts = []
    if len(parts) != 2 or any(len(part) != count for part in parts):
        raise WrongUsage(f"{name} '{text}' is not LOW:HIGH", fix=f"such as {name} {SUCH_AS[name]}")
    return parts[0], parts[1]


def _prior(value: Any, name: str) -> Path | Prior | None:  # noqa: ANN401
    if value is None or isinstance(value, (Path, Prior)):
        return value
    if not isinstance(value, str):
        raise WrongUsage(f"{name} {value!r:.60} is no file", fix=f"such as {name} prior.yaml")
    return Path(value)


@dataclass(frozen=True)
class PriorOptions(Options):
    """What is known about the bodies of an arm before anything is measured."""

    prior: Path | Prior | None = option(
        None,
        "Link inertias that are known before measuring: a YAML file with `links:` or `cylinders:`, or a URDF of this "
        "arm (default: those of the robot file).",
        metavar="FILE",
        kind="file",
        read=_prior,
    )
    total_mass: Range | None = option(
        None,
        "Smallest and largest mass of all identified links together [kg].",
        metavar="LOW:HIGH",
        read=_range,
    )
    link_mass: tuple[tuple[int, Range], ...] = option(
        (),
        "Smallest and largest mass of one link [kg]; may be repeated.",
        metavar="LINK=LOW:HIGH",
        repeatable=True,
        read=_ranges,
    )
    com_box: tuple[tuple[int, tuple[Corner, Corner]], ...] = option(
        (),
        "Corners of the box around a link's centre of mass, in its DH frame [m]; may be repeated.",
        metavar="LINK=X,Y,Z:X,Y,Z",
        repeatable=True,
        read=_boxes,
    )

    @property
    def given(self) -> bool:
        """Whether any option says what is known of the bodies."""
        return (
            self.prior is not None
            or self.total_mass is not None
            or bool(self.link_mass or self.com_box)
        )


@dataclass(frozen=True)
class IdentifyOptions(PriorOptions, LogOptions):
    """How parameters are identified."""

    method: str = option(
        "auto",
        "Estimator; auto takes the one that the log allows and reports why.",
        choices=METHODS,
        shown="",
    )
    feasible: bool | None = option(
        None,
        "Predict with the physically possible parameters, or with the plain estimate (default: the physically possible "
        "ones, unless --method names an estimator).",
        pair=True,
    )
    residual_model: bool | None = option(
        None,
        "Fit a residual model to what rigid bodies and friction leave unexplained, and use it in predictions (default: "
        "when the data support it).",
        pair=True,
    )
    holdout: float | str | Path | Log | None = option(
        "auto",
        "Data kept back to judge the fit: a share at the end of each log, another log, or nothing; auto keeps back the "
        "last motion if the logs hold several, else the last 20 % of each log.",
        metavar="auto|SHARE|LOG|none",
        shown="auto",
        read=_holdout,
    )
    drop_weak: bool = option(
        False, "Continue when the log does not determine all parameters, or only badly."
    )


@dataclass(frozen=True)
class ValidateOptions(LogOptions):
    """How a log is replayed. Filter and delay are those of the result where nothing else is asked for."""

    allow_training_data: bool = option(False, "Accept the recording that was used to identify.")
    residual_model: bool | None = option(
        None,
        "Predict with the result's residual model, or by its parameters alone (default: with it).",
        pair=True,
    )


#: The formats by name with their suffixes, repeated from ``dynid.exporters`` so that help needs no import.
SUFFIXES = {
    "urdf": ".urdf",
    "mjcf": ".xml",
    "yaml": ".yaml",
    "c": ".c",
    "python": ".py",
    "matlab": ".m",
}


@dataclass(frozen=True)
class ExportOptions(Options):
    """What is exported.

    Attributes:
        parameters: ``"physical"``, ``"plain"``, or ``"auto"``: physical where bodies are written, else what is in
            force.
        urdf: the user's own URDF, which keeps everything but its inertial blocks.
        allow_infeasible: write also bodies that cannot exist.
        residual_model: predict with the residual model of the result where the format can, which is code.
        draws: so many arms are drawn from the posterior and written to ``draws/`` in the formats of simulators.
    """

    parameters: str = option(
        "auto",
        "Parameters to write; auto takes the physical ones for formats with bodies, else those used for predictions.",
        choices=("auto", "physical", "plain"),
        flag="--set",
        shown="",
    )
    urdf: Path | None = option(
        None, "Your URDF: its inertial blocks are replaced, the rest is kept.", kind="input"
    )
    allow_infeasible: bool = option(
        False, "Also write bodies that cannot exist; simulators may refuse them."
    )
    residual_model: bool = option(
        True,
        "Let exported code use the result's residual model, or the parameters alone.",
        pair=True,
    )
    draws: int = option(
        0, "Also write so many arms drawn from the posterior (URDF, MJCF).", bounds=(0, 10_000)
    )


def _effect_specs(value: Any, name: str) -> tuple[EffectSpec, ...]:  # noqa: ANN401
    """Return effects from NAME@JOINT,...:PARAMETER=NUMBER,... or from entries of a robot file."""
    found = []
    for item in (value,) if isinstance(value, (str, EffectSpec)) else value:
        if isinstance(item, EffectSpec):
            found.append(item)
            continue
        if not isinstance(item, str):
            raise TypeError("it must be a list of words")
        head, _, numbers = str(item).partition(":")
        effect, _, joints = head.partition("@")
        try:
            pairs = [part.split("=") for part in numbers.split(",") if part]
            parameters = {key.strip(): float(number) for key, number in pairs}
        except ValueError:
            raise WrongUsage(
                f"{name} '{item}' is not understood", fix=f"{name} viscous@joint_2:fv=4.5"
            ) from None
        if not all(abs(number) <= MOST for number in parameters.values()):
            raise WrongUsage(f"{name} '{item}' has a number beyond what can be measured")
        found.append(
            EffectSpec(effect, tuple(joint for joint in joints.split(",") if joint), parameters)
        )
    return tuple(found)


@dataclass(frozen=True)
class SimulateOptions(Options):
    """What is simulated beyond the rigid bodies of the robot file."""

    viscous: float = option(
        0.02, "Viscous friction of each joint as a share of its rated torque at its rated speed."
    )
    coulomb: float = option(0.03, "Coulomb friction of each joint as a share of its rated torque.")
    noise: float = option(
        0.003, "Standard deviation of the torques as a share of the rated torque.", kind="float"
    )
    resolution: float = option(
        1e-5, "Resolution of the position sensors [rad or m]; 0 for none.", kind="float"
    )
    delay: float = option(0.0, "How late the torques are in the log [s].")
    payload: float = option(
        0.0, "Mass of a point load at the origin of the last frame [kg].", kind="float"
    )
    effects: tuple[EffectSpec, ...] = option(
        (),
        "Effect of the catalogue, NAME@JOINT:PARAMETER=NUMBER,...; may be repeated.",
        metavar="EFFECT",
        repeatable=True,
        flag="--effect",
        read=_effect_specs,
    )
    seed: int = option(0, "Seed of the noise.")


@dataclass(frozen=True)
class ConvertOptions(Options):
    """Which joint states are converted."""

    topic: str | None = option(
        None,
        "ROS topic of the joint states (default: the one with most messages).",
        metavar="TOPIC",
    )
    rate: float | None = option(
        None, "Sample rate [Hz] of text logs without a time column.", metavar="HZ", kind="positive"
    )


@dataclass(frozen=True)
class ImportOptions(Options):
    """Which arm of a URDF, and how its table is written."""

    base: str | None = option(None, "First link of the arm (default: the root).", metavar="LINK")
    tip: str | None = option(
        None, "Last link of the arm (default: where the chain ends or forks).", metavar="LINK"
    )
    convention: Literal["standard", "modified"] = option(
        "standard", "DH convention.", choices=("standard", "modified"), shown=""
    )
    name: str | None = option(None, "Name of the robot (default: the URDF's).", metavar="NAME")


@dataclass(frozen=True)
class SimDriverOptions(Options):
    """What is simulated, and how well it measures."""

    rate: float = option(100.0, "Rate of the joint states [Hz].", bounds=(1, 1000), shown="")
    topic: str | None = option(None, "Topic of the joint states (default: the robot file's).")
    master: str | None = option(
        None, "Address of the ROS master (default: ROS_MASTER_URI).", metavar="URI"
    )
    pose: str | Sequence[float] | None = option(
        None,
        "Where the arm stands: at the start of a trajectory, or at DH positions [rad or m].",
        metavar="TRAJECTORY|Q1,Q2,...",
    )
    truth: Path | None = option(
        None,
        "Truth file of the simulated arm (default: the one that ships for the robot).",
        kind="input",
    )
    torque_noise: float | None = option(
        None,
        "Standard deviation of all torques [N m] (default: the truth file's).",
        metavar="NM",
        kind="float",
    )
    torque_step: float = option(0.0, "Resolution of the torques [N m].", metavar="NM", kind="float")
    torque_offset: float = option(
        0.0, "Offset of all torque sensors until they are zeroed [N m].", metavar="NM"
    )
    position_step: float | None = option(
        None,
        "Resolution of the encoders [rad] (default: the truth file's).",
        metavar="RAD",
        kind="float",
    )
    latency: float = option(
        0.0, "Time from sampling to publishing [s].", metavar="S", bounds=(0, 1)
    )
    jitter: float = option(
        0.0, "Standard deviation added to the latency [s].", metavar="S", bounds=(0, 1)
    )
    drop: float = option(
        0.0, "Share of the messages that are lost.", metavar="SHARE", bounds=(0, 1)
    )
    skew: float = option(
        0.0,
        "How much later than the position torque and velocity are polled [s] (Kinova).",
        metavar="S",
        bounds=(0, 1),
    )
    duration: float | None = option(
        None, "Length of the simulation [s] (default: until Ctrl-C).", metavar="S", kind="positive"
    )
    seed: int = option(0, "Seed of all noise.")


def _quantity(unit: str, most: float) -> Callable[[Any, str], float]:
    """Return a reader of positive numbers with a unit, up to the largest one; percent become a share."""

    def read(value: Any, name: str) -> float:  # noqa: ANN401
        text = str(value).strip()
        try:
            number = float(text.removesuffix(unit)) * (0.01 if text.endswith("%") else 1.0)
        except ValueError:
            number = 0.0
        if not 0 < number <= most:
            raise WrongUsage(
                f"{name} {value} is not a positive number of {unit} up to {100 * most if unit == '%' else most:g}"
            )
        return number

    return read


@dataclass(frozen=True)
class RecordOptions(Options):
    """How a motion is played and recorded."""

    dry_run: bool = option(False, "Check everything and end before the arm is moved.")
    listen_only: bool = option(
        False, "Only record; another program moves the arm. Needs no TRAJECTORY."
    )
    repeat: int = option(
        1,
        "How many times the motion is played, each time into the same log.",
        bounds=(1, 1000),
        shown="",
    )
    speed: float = option(
        "100%",
        "Speed of the motion, as a share of the planned one.",
        metavar="SHARE",
        shown="",
        read=_quantity("%", 10.0),
    )
    max_deviation: float = option(
        "0.15rad",
        "Stop the arm when a joint is further than this from the planned position [rad or m].",
        metavar="DISTANCE",
        shown="",
        read=_quantity("rad", 1e3),
        deliberate=True,
    )
    master: str | None = option(
        None, "Address of the ROS master (default: ROS_MASTER_URI).", metavar="URI"
    )
    topic: str | None = option(
        None, "Topic of the joint states (default: the robot file's).", metavar="T"
    )
    command_topic: str | None = option(
        None, "Topic or action of the commands (default: the driver's).", metavar="T"
    )
    timeout: float = option(
        "2s",
        "How long to wait for the ROS master and for messages [s].",
        metavar="SECONDS",
        shown="",
        read=_quantity("s", 86400.0),
    )
    accept_unreviewed: bool = option(
        False, "Play a motion whose preview nobody has confirmed.", deliberate=True
    )
    go_to_start: bool = option(
        False, "First move the arm slowly to the start of the motion.", deliberate=True
    )
    zero_torques: bool = option(
        False,
        "Zero the torque sensors before the motion (Kinova, in the candle pose).",
        deliberate=True,
    )
    duration: float | None = option(
        None,
        "Length of a recording with --listen-only [s] (default: until the messages stop).",
        metavar="S",
        kind="positive",
    )


@dataclass(frozen=True)
class Extras(Options):
    """What ``dynid identify`` is asked besides the parameters."""

    payload_from: Path | None = option(
        None,
        "Result without the load: find mass, centre and inertia of the load that the arm of the LOG carries.",
        metavar="RESULT",
        kind="path",
    )
    loaded: Path | None = option(
        None,
        "Log of motor currents with a load of known mass: find the gains of all drives.",
        metavar="LOG",
        kind="path",
    )
    load_mass: float | None = option(
        None,
        "Mass of the load in the log given with --loaded [kg].",
        metavar="KG",
        kind="positive",
    )
    update: Path | None = option(
        None,
        "Add the LOG to this result; its own logs are not needed. It may be overwritten.",
        metavar="RESULT",
        kind="path",
    )
