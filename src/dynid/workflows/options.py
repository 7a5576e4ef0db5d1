"""What the workflows may be told: their options, which the command line, configuration files and notebooks share."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Literal

from dynid.arguments import no_such
from dynid.log import Log
from dynid.options import (
    LEAST,
    LogOptions,
    Options,
    number_or_nan,
    numbers,
    option,
    quantity,
)
from dynid.robot import EffectSpec, Prior
from dynid.text import whole_number

#: Columns that each joint may have beyond its link's ten parameters.
EFFECTS = ("viscous", "coulomb", "offset", "motor_inertia")
#: Earlier names of two questions of a gap search.
MODES = {"refit": "numbers", "frozen": "changed"}
#: Names of the formats, repeated from ``dynid.exporters`` so that help needs no import.
FORMATS = ("urdf", "mjcf", "yaml", "c", "python", "matlab")

Range = tuple[float, float]
Corner = tuple[float, float, float]


# ---------------------------------------------------------------- readers; a ValueError says what is wrong
def _bounds(value: Any, count: int = 1) -> tuple[Any, Any]:  # noqa: ANN401
    """Return the lower and upper bound of LOW:HIGH, or of a pair: numbers, or corners of so many."""
    parts = value.split(":") if isinstance(value, str) else value
    if len(parts) != 2:
        raise ValueError(f"'{value}' is not LOW:HIGH")
    low, high = (numbers(part, count) for part in parts)
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise ValueError(f"'{value}': the first must be the lower one")
    return (low, high) if count > 1 else (low[0], high[0])


def _of_links(value: Any, count: int = 1) -> tuple[tuple[int, Any], ...]:  # noqa: ANN401
    """Return the bounds of links: words LINK=LOW:HIGH, or pairs of a link and its bounds."""
    pairs = []
    for item in value:
        link, bounds = item.partition("=")[::2] if isinstance(item, str) else item
        number = whole_number(str(link).strip())
        if number < 1:
            raise ValueError(f"'{item}' does not begin with LINK=, the number of a link")
        pairs.append((number, _bounds(bounds, count)))
    return tuple(pairs)


def _words(value: Any) -> tuple[str, ...]:  # noqa: ANN401
    """Return words given as text with commas or one by one; () for ``all`` and for nothing."""
    items = [value] if isinstance(value, (str, int)) else list(value or ())
    if not all(isinstance(item, (str, int)) for item in items):
        raise TypeError("it must be a word or a list of words")
    words = [word.strip() for item in items for word in str(item).split(",")]
    return () if words == ["all"] else tuple(word for word in words if word)


def _effects(value: Any) -> tuple[str, ...]:  # noqa: ANN401
    words = () if value == "none" else _words(value)
    for word in words:
        if word not in EFFECTS:
            raise ValueError(f"no effect '{word}'; choose from {', '.join(EFFECTS)}, or none")
    return words


def _holdout(value: Any) -> Any:  # noqa: ANN401
    """Return a share, ``auto``, or a log (its path until it is read)."""
    if value == "auto" or isinstance(value, (Log, Path)):
        return value
    if not isinstance(value, (str, float)):
        raise TypeError("it is neither a share nor a log")
    text = str(value)
    digits = text.removesuffix("%").replace(".", "", 1)
    return quantity(value) if digits.isdigit() else Path(text)


def _effect_specs(value: Any) -> tuple[EffectSpec, ...]:  # noqa: ANN401
    """Return effects from NAME@JOINT,...:PARAMETER=NUMBER,... or from entries of a robot file."""
    specs = []
    for item in (value,) if isinstance(value, (str, EffectSpec)) else value:
        made = item
        if isinstance(item, str):
            head, _, numbers = item.partition(":")
            effect, _, joints = head.partition("@")
            pairs = [part.partition("=") for part in numbers.split(",") if part]
            parameters = {key.strip(): number_or_nan(number) for key, _, number in pairs}
            made = EffectSpec(effect, tuple(filter(None, joints.split(","))), parameters)
        if not (isinstance(made, EffectSpec) and all(map(isfinite, made.parameters.values()))):
            raise ValueError("it is no effect with numbers, such as viscous@joint_2:fv=4.5")
        specs.append(made)
    return tuple(specs)


def joint_indices(names: Sequence[str], words: Iterable[str], option: str) -> tuple[int, ...]:
    """Return 0-based joints given by name, by number from 1, or as a range such as ``2-4``."""
    indices: dict[int, None] = {}
    for word in filter(None, map(str.strip, words)):
        span = re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", word, re.ASCII)
        first, last = (int(span[1]), int(span[2] or span[1])) if span else (0, 0)
        if word in names:
            first = last = list(names).index(word) + 1
        if not 1 <= first <= last <= len(names):
            raise no_such(f"{option}: no joint", word, names, fix=f"1 to {len(names)}, or a name")
        indices |= dict.fromkeys(range(first - 1, last))
    return tuple(indices)


# ---------------------------------------------------------------- options
@dataclass(frozen=True)
class ModelOptions(Options):
    """What differs from the robot file, and how the base parameters are found."""

    gravity: tuple[float, float, float] | None = option(
        None,
        "Gravity in frame 0 [m/s^2], instead of the robot file's.",
        metavar="X,Y,Z",
        read=partial(numbers, count=3),
    )
    effects: tuple[str, ...] | None = option(
        None,
        f"Columns of every joint: some of {','.join(EFFECTS)}; or none.",
        metavar="LIST",
        read=_effects,
    )
    links: tuple[str, ...] | None = option(
        None,
        "Links to identify, such as 1-7 or 4,5,6; the others keep the prior.",
        metavar="LIST",
        read=_words,
    )
    samples: int = option(
        200,
        "Number of random states at which singular values are computed.",
        bounds=(10, 100_000),
    )
    tolerance: float | None = option(
        None,
        "Relative singular value below which columns count as dependent.",
        metavar="auto|X",
        nothing="auto",
        read=float,
        bounds=(0, 1),
    )


@dataclass(frozen=True)
class IdentifyOptions(LogOptions):
    """How parameters are identified, and what is known about the bodies before anything is measured."""

    prior: Path | Prior | None = option(
        None,
        "Link inertias that are known before measuring: a YAML file with `links:` or `cylinders:`, or a URDF of this "
        "arm (default: those of the robot file).",
        metavar="FILE",
        read=lambda value: value if isinstance(value, Prior) else Path(value),
    )
    total_mass: Range | None = option(
        None,
        "Smallest and largest mass of all identified links together [kg].",
        metavar="LOW:HIGH",
        read=_bounds,
    )
    link_mass: tuple[tuple[int, Range], ...] = option(
        (),
        "Smallest and largest mass of one link [kg]; may be repeated.",
        metavar="LINK=LOW:HIGH",
        repeatable=True,
        read=_of_links,
    )
    com_box: tuple[tuple[int, tuple[Corner, Corner]], ...] = option(
        (),
        "Corners of the box around a link's centre of mass, in its DH frame [m]; may be repeated.",
        metavar="LINK=X,Y,Z:X,Y,Z",
        repeatable=True,
        read=partial(_of_links, count=3),
    )

    method: str = option(
        "auto",
        "Estimator; auto takes the one that the log allows and reports why.",
        choices=("auto", "wls", "ols", "irls", "iv", "ridge"),
    )
    feasible: bool | None = option(
        None,
        "Predict with physically consistent parameters, or with least squares (default: the physically consistent "
        "ones, unless --method names an estimator).",
    )
    residual_model: bool | None = option(
        None,
        "Fit a residual model to the torque that rigid bodies and friction do not explain, and use it for prediction "
        "(default: when the data support it).",
    )
    holdout: float | str | Path | Log | None = option(
        "auto",
        "Held-out data: a share at the end of each log, another log, or none; auto holds out the "
        "last motion if the logs hold several, else the last 20 % of each log.",
        metavar="auto|SHARE|LOG|none",
        nothing="none",
        read=_holdout,
    )
    drop_weak: bool = option(
        False, "Continue when the log does not determine all parameters, or only badly."
    )

    @property
    def given(self) -> bool:
        """Whether any option says what is known of the bodies."""
        return any((self.prior, self.total_mass, self.link_mass, self.com_box))


@dataclass(frozen=True)
class ValidateOptions(LogOptions):
    """How a log is replayed. Filter and delay are those of the result where nothing else is asked for."""

    allow_training_data: bool = option(False, "Accept the recording that was used to identify.")
    max_rms: float | None = option(
        None,
        "Exit 1 if the rms torque error of any joint is larger [N m or N].",
        bounds=(0, None),
    )
    max_unexplained: float | None = option(
        None,
        "Exit 1 if the total relative torque error is larger.",
        metavar="SHARE",
        read=quantity,
    )
    residual_model: bool | None = option(
        None,
        "Predict with the result's residual model, or by its parameters alone (default: with it).",
    )


@dataclass(frozen=True)
class GapOptions(LogOptions):
    """What is searched. The filter keeps what happens at reversals where no other cut-off is asked for."""

    ask: str = option(
        "auto",
        "numbers: effects that remain after refitting all parameters; arm: effects that only implausible links could "
        "imitate; changed: what has changed since the model was identified; auto chooses by the logs and says why.",
        choices=("auto", "numbers", "arm", "changed"),
    )
    mode: str | None = option(
        None,
        "Earlier names of two questions: refit is --ask numbers, frozen is --ask changed.",
        choices=tuple(MODES),
    )
    effects: tuple[str, ...] = option(
        "all",
        "Effects to try, by identifier, separated by commas.",
        metavar="all|LIST",
        read=_words,
    )
    joints: tuple[str, ...] = option(
        None,
        "Joints to search, by name, by number, or as a range such as 2-4 (default: all).",
        metavar="LIST",
        read=_words,
    )
    false_alarm: float = option(
        "1%",
        "Probability of naming an effect in logs where none is missing.",
        metavar="SHARE",
        read=quantity,
    )
    max_effects: int = option(3, "Largest number of effects that are selected.", bounds=(1, None))

    @property
    def question(self) -> str:
        """What is asked."""
        return MODES.get(self.mode or "", self.ask)


@dataclass(frozen=True)
class ExportOptions(Options):
    """What is exported."""

    parameters: str = option(
        "auto",
        "Parameters to write; auto takes the physical ones for formats with bodies, else those used for predictions.",
        choices=("auto", "physical", "plain"),
        flag="--set",
    )
    urdf: Path | None = option(
        None, "Your URDF: its inertial blocks are replaced, the rest is kept.", kind="input"
    )
    allow_infeasible: bool = option(
        False, "Also write physically inconsistent bodies; simulators may refuse them."
    )
    residual_model: bool = option(
        True,
        "Let exported code use the result's residual model, or the parameters alone.",
    )
    draws: int = option(
        0, "Also write so many arms drawn from the posterior (URDF, MJCF).", bounds=(0, 10_000)
    )


@dataclass(frozen=True)
class SimulateOptions(Options):
    """What is simulated beyond the rigid bodies of the robot file."""

    viscous: float = option(
        0.02, "Viscous friction of each joint as a share of its rated torque at its rated speed."
    )
    coulomb: float = option(0.03, "Coulomb friction of each joint as a share of its rated torque.")
    noise: float = option(
        0.003, "Standard deviation of the torques as a share of the rated torque.", bounds=(0, None)
    )
    resolution: float = option(
        1e-5, "Resolution of the position sensors [rad or m]; 0 for none.", bounds=(0, None)
    )
    delay: float = option(0.0, "How late the torques are in the log [s].")
    payload: float = option(
        0.0, "Mass of a point load at the origin of the last frame [kg].", bounds=(0, None)
    )
    effects: tuple[EffectSpec, ...] = option(
        (),
        "Effect of the catalogue, NAME@JOINT:PARAMETER=NUMBER,...; may be repeated.",
        metavar="EFFECT",
        repeatable=True,
        flag="--effect",
        read=_effect_specs,
    )
    seed: int = option(0, "Seed of the noise.", bounds=(0, None))


@dataclass(frozen=True)
class CompareOptions(Options):
    """Which changes count."""

    tolerance: float | None = option(
        None,
        "Largest change of any number against the baseline; without it the noise is the measure.",
        metavar="SHARE",
        read=quantity,
    )


@dataclass(frozen=True)
class ImportOptions(Options):
    """Which arm of a URDF, and how its table is written."""

    base: str | None = option(None, "First link of the arm (default: the root).", metavar="LINK")
    tip: str | None = option(
        None, "Last link of the arm (default: where the chain ends or forks).", metavar="LINK"
    )
    convention: Literal["standard", "modified"] = option(
        "standard", "DH convention.", choices=("standard", "modified")
    )
    name: str | None = option(None, "Name of the robot (default: the URDF's).", metavar="NAME")


@dataclass(frozen=True)
class RecordOptions(Options):
    """How a motion is played and recorded."""

    move: str | None = option(
        None,
        "Move without asking: the robot's name, as a person would type it.",
        metavar="ROBOT_NAME",
        deliberate=True,
    )
    dry_run: bool = option(False, "Check everything and end before the arm is moved.")
    listen_only: bool = option(
        False, "Only record; another program moves the arm. Needs no TRAJECTORY."
    )
    repeat: int = option(
        1,
        "How many times the motion is played, each time into the same log.",
        bounds=(1, 1000),
    )
    speed: float = option(
        "100%",
        "Speed of the motion, as a share of the planned one.",
        read=partial(quantity, most=10.0),
    )
    max_deviation: float = option(
        "0.15rad",
        "Stop the arm when a joint is further than this from the planned position [rad or m].",
        read=partial(quantity, unit="rad", most=1e3),
        deliberate=True,
    )
    master: str | None = option(None, "Address of the ROS master (default: ROS_MASTER_URI).")
    topic: str | None = option(None, "Topic of the joint states (default: the robot file's).")
    command_topic: str | None = option(
        None, "Topic or action of the commands (default: the driver's)."
    )
    timeout: float = option(
        "2s",
        "How long to wait for the ROS master and for messages [s].",
        read=partial(quantity, unit="s", most=86400.0),
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
        bounds=(LEAST, None),
    )


@dataclass(frozen=True)
class IdentifyRunOptions(IdentifyOptions):
    """What ``dynid identify`` may be told: besides how parameters are identified, what else is asked of the logs."""

    payload_from: Path | None = option(
        None,
        "Result without the load: find mass, centre and inertia of the load that the arm of the LOG carries.",
        metavar="RESULT",
    )
    loaded: Path | None = option(
        None,
        "Log of motor currents with a load of known mass: find the gains of all drives.",
        metavar="LOG",
    )
    load_mass: float | None = option(
        None,
        "Mass of the load in the log given with --loaded [kg].",
        bounds=(LEAST, None),
    )
    update: Path | None = option(
        None,
        "Add the LOG to this result; its own logs are not needed. It may be overwritten.",
        metavar="RESULT",
    )
