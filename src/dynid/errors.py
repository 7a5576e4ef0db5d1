"""User-visible mistakes, a class each, from which the message and the page of its code (``codes``) are made."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, ClassVar


class ExitStatus(IntEnum):
    """Exit statuses of every command."""

    DONE = 0
    LIMIT_NOT_MET = 1
    USAGE = 2
    INPUT = 3
    DATA = 4
    UNSAFE = 5
    MACHINE = 6
    DECISION = 7
    INTERNAL = 70
    INTERRUPTED = 130


EXIT_MEANING: dict[ExitStatus, str] = {
    ExitStatus.DONE: "done",
    ExitStatus.LIMIT_NOT_MET: "done, but a limit you set was not met",
    ExitStatus.USAGE: "wrong usage",
    ExitStatus.INPUT: "an input file is wrong",
    ExitStatus.DATA: "the data cannot answer (too short, not exciting, rank)",
    ExitStatus.UNSAFE: "unsafe: limits, collision, tracking",
    ExitStatus.MACHINE: "the machine lacks something (ROS, display, package, permission)",
    ExitStatus.DECISION: "a decision is needed and nobody can be asked",
    ExitStatus.INTERNAL: "internal error, a crash file was written",
    ExitStatus.INTERRUPTED: "interrupted",
}


@dataclass(frozen=True)
class Finding:
    """Something worth saying that does not stop the run.

    Attributes:
        code: catalogue code such as ``"W316"``.
        level: ``"warning"`` or ``"info"``.
        text: one sentence for a person.
        evidence: the numbers behind the sentence, JSON-able.
    """

    code: str
    level: str
    text: str
    evidence: dict[str, Any] = field(default_factory=dict)


#: Exit status of the mistakes of a topic, the first digit of their codes, where it is not that number.
OTHER_STATUS = {1: ExitStatus.USAGE, 2: ExitStatus.INPUT}


class DynidError(Exception):
    """Base of all mistakes that dynid reports to a person.

    Args:
        what: what was found, with number, joint name, time.
        where: file and line, topic, or command.
        why: why it matters; the class default when empty.
        fix: the next command or edit; the class default when empty.
    """

    code: ClassVar[str] = "E700"
    status: ClassVar[ExitStatus] = ExitStatus.INTERNAL
    why: str = ""
    fix: str = ""

    def __init_subclass__(cls) -> None:
        """Give a mistake the status of its topic where it has none of its own."""
        if "status" not in vars(cls):
            topic = int(cls.code[1])
            cls.status = OTHER_STATUS.get(topic, ExitStatus(topic))

    def __init__(self, what: str, *, where: object = "", why: str = "", fix: str = "") -> None:
        self.what, self.where = what, str(where)
        self.why, self.fix = why or type(self).why, fix or type(self).fix
        super().__init__(what)
        # Why: a notebook shows a traceback, whose last lines these are; from Python 3.11 on.
        if sys.version_info >= (3, 11):
            self.add_note(f"fix: {self.fix}")


@contextmanager
def located(where: object) -> Iterator[None]:
    """Give a mistake that does not say where it was found a place, such as the name of its log."""
    try:
        yield
    except DynidError as error:
        error.where = error.where or str(where)
        raise


# ---------------------------------------------------------------- 1: the command line
class WrongUsage(DynidError):
    """An option or argument has a value that the command cannot use."""

    code = "E101"
    why = "the command cannot use this value"
    fix = "see the command's help: dynid COMMAND -h"


# ---------------------------------------------------------------- 2: robot file
class UnknownKey(DynidError):
    """The YAML file has a key that dynid does not know."""

    code = "E201"
    why = "a misspelt key would be ignored, and its default used instead"
    fix = "rename or remove the key; `dynid explain robot-file` lists all keys"


class AngleTooLarge(DynidError):
    """An angle of the DH table is more than a full turn."""

    code = "E202"
    why = "angles are read in radians unless the file says otherwise"
    fix = "add `angle_unit: deg` to the robot file, or write the angle as `90 deg`"


class NotANumber(DynidError):
    """A value of the YAML file is text, or YAML reads it as something else, where a number belongs."""

    code = "E203"
    why = "YAML 1.1 reads 1e-3 as text, 012 as octal, 1:30 as 90 and off as false"
    fix = "write a plain decimal number such as 1.0e-3"


class MissingConvention(DynidError):
    """The robot file does not say which DH convention its table uses."""

    code = "E204"
    why = "standard (distal) and modified (proximal, Craig/Khalil) tables describe different robots"
    fix = "add `convention: standard` or `convention: modified`; `dynid explain robot-file` says how to tell"


class RobotNotFound(DynidError):
    """No robot file with that name or path."""

    code, status = "E205", ExitStatus.USAGE
    why = "ROBOT is a name in robots/ or the path of a YAML file"
    fix = "give one of the known names or a path"


class ImplausibleGravity(DynidError):
    """The gravity vector has a length that no place on Earth has."""

    code = "E206"
    why = "masses and first moments scale with gravity, so a wrong unit spoils all of them"
    fix = "give gravity in m/s^2, for example [0, 0, -9.81]"


class NotYaml(DynidError):
    """The file is not valid YAML, or gives a key twice."""

    code = "E207"
    why = "the rest of the file cannot be trusted"
    fix = "correct the line; indent with spaces, give each key once"


class WrongRobotFile(DynidError):
    """A key is missing from a YAML file or has a value that cannot be used."""

    code = "E208"
    why = "something else would be done than what is meant"
    fix = "correct the value; `dynid explain robot-file` describes each key of a robot file"


class ReductionsDisagree(DynidError):
    """The singular values leave open how many base parameters there are."""

    code = "E209"
    why = "a value of the DH table or of gravity is close to a special value such as 90 deg or 0, but not equal to it"
    fix = "write the special value exactly (90 deg instead of 1.57, 0 instead of 1e-9), or move it away from it"


class WrongUrdf(DynidError):
    """The URDF cannot be read, or is not the serial arm that is asked for."""

    code = "E210"
    why = "one chain of revolute and prismatic joints is needed"
    fix = "expand a xacro first; name the ends of the chain with --base and --tip"


# ---------------------------------------------------------------- 3: logs
class LogNotFound(DynidError):
    """There is no such log, or the file is not a log."""

    code = "E301"
    why = "a log is a .bag, .db3, .mcap, .npz, .csv or .tsv file, or a folder of rosbag2 or of text files"
    fix = "check the path"


class TopicMissing(DynidError):
    """The topic is not in the bag."""

    code = "E303"
    why = "joint states are read from one topic"
    fix = "name one of the topics with --topic"


class WrongMessageType(DynidError):
    """The topic carries a message that does not hold joint positions and torques."""

    code = "E304"
    why = "positions and torques with time stamps are needed"
    fix = "choose the joint_state topic with --topic"


class BagTruncated(DynidError):
    """The bag ends early or has no index, and too little of it can be read."""

    code = "E305"
    why = "the recorder was probably killed before it closed the file"
    fix = "record again, or repair a copy: rosbag reindex LOG.bag, mcap recover LOG.mcap, sqlite3 LOG.db3 .recover"


class NotFinite(DynidError):
    """The log has samples that are not a number or infinite."""

    code = "E306"
    why = "one such value spoils every parameter"
    fix = "leave that time out with --exclude T0-T1"


class PositionInDegrees(DynidError):
    """Positions go beyond the joint's limits but would fit in radians after division by 57.3."""

    code = "E307"
    why = "the log is probably in degrees"
    fix = "add `units: {position: deg}` under `driver:` in the robot file"


class VelocityInconsistent(DynidError):
    """The measured velocity is not the change of the measured position."""

    code = "E308"
    why = "unit or sign of the velocity column is wrong"
    fix = "correct `driver.units.velocity` or `driver.sign`, or use --velocity derived"


class JointNamesDiffer(DynidError):
    """The log's joint names are not those of the robot file, or two columns look swapped."""

    code = "E309"
    why = "columns are taken by name, never by position"
    fix = "list the log's names in chain order under `driver.joint_names`"


class JointCountDiffers(DynidError):
    """The file has another number of joints than the robot."""

    code = "E310"
    why = "one column per joint is needed"
    fix = "use the robot file that belongs to this recording"


class TimeNotIncreasing(DynidError):
    """Time stamps go back or stand still."""

    code = "E311"
    why = "derivatives over such a step are meaningless"
    fix = (
        "leave the overlap out with --exclude T0-T1, or use --sort-time if stamps are only shuffled"
    )


class TooManyLost(DynidError):
    """More than one sample in twenty is missing."""

    code = "E312"
    why = "filtering and differentiation need an even time grid"
    fix = "record again closer to the driver, with less load on the machine"


class LogTooShort(DynidError):
    """The log is too short for the number of parameters."""

    code, status = "E313", ExitStatus.DATA
    why = "each parameter needs motion that excites it"
    fix = "record a longer motion"


class RateTooLow(DynidError):
    """Samples arrive too rarely for the motion."""

    code, status = "E314", ExitStatus.DATA
    why = "accelerations cannot be found from so few samples"
    fix = "raise the driver's publishing rate"


class GravityRemoved(DynidError):
    """Torques at rest do not change with the pose: the driver has subtracted gravity."""

    code = "E317"
    why = "masses and first moments are identified through gravity"
    fix = (
        "set the driver parameter publish_torque_with_gravity_compensation to false, "
        "or say `torque: {source: gravity_free}`"
    )


class TorqueScale(DynidError):
    """Torques are far beyond the joint's rating."""

    code = "E318"
    why = "the unit is probably mN m or a raw count"
    fix = "add `units: {effort: mNm}` under `driver:` in the robot file"


class NewerSchema(DynidError):
    """The file was written by a newer dynid."""

    code = "E320"
    why = "its contents may mean something else"
    fix = "upgrade dynid"


class NotAnArtifact(DynidError):
    """The file is not a dynid result, or is damaged."""

    code = "E321"
    why = "results are .npz files with a dynid header"
    fix = "make the file again with the command that writes it"


class LogLayout(DynidError):
    """A log does not have the arrays or columns that are needed."""

    code = "E322"
    why = "positions and torques of every joint and the time are needed"
    fix = "`dynid explain log-format` says what is read"


class TooLarge(DynidError):
    """A compressed file unpacks to far more than recordings and results do."""

    code = "E323"
    why = "a file that somebody else made could fill the memory of this machine"
    fix = "write it again without compression"


class WrongMapping(DynidError):
    """The robot file does not describe the arm that made the log: an edit of it explains the torques far better."""

    code = "E324"
    why = "the model explains little more than a constant and friction"
    fix = (
        "correct the DH convention, signs, offsets or order of the columns in the robot file, "
        "or continue with --anyway"
    )


# ---------------------------------------------------------------- 4: what the data can answer
class JointStill(DynidError):
    """A joint never moves in the log."""

    code = "E401"
    why = "its inertia and friction do not show in the torques"
    fix = "record a motion in which every joint moves, or add --drop-weak: its parameters come from the prior"


class PoorlyExcited(DynidError):
    """The log determines so little that the torque error of least squares on other motions would be 50 % or more."""

    code = "E402"
    why = "some parameters are poorly excited"
    fix = "plan a better motion: dynid trajectory ROBOT --optimise"


class RankDeficient(DynidError):
    """The log determines fewer base parameters than the structure has."""

    code = "E403"
    why = "some base parameters cannot be distinguished in this motion"
    fix = "record a motion that excites them, or continue with --drop-weak"


class NotPhysical(DynidError):
    """No physical body comes near the identified parameters."""

    code, status = "E404", ExitStatus.LIMIT_NOT_MET
    why = "units, joint signs or the payload are probably wrong"
    fix = "check the driver map and units with: dynid check LOG"


class SameRecording(DynidError):
    """The validation log is the one that was used to identify."""

    code, status = "E405", ExitStatus.USAGE
    why = "a model always fits the data it was made from"
    fix = "give another recording, or --allow-training-data"


class NothingChanged(DynidError):
    """The optimiser returned its starting point."""

    code = "E406"
    why = "the result would be the prior again"
    fix = "check that the arm moves in the log and that the options leave parameters free"


class NotSimulated(DynidError):
    """The arm could not be simulated."""

    code = "E407"
    why = "with inconsistent parameters the simulation diverges"
    fix = "identify with a log that determines the arm's parameters"


class WeakInstruments(DynidError):
    """Estimates from the commanded motion explain the log far worse than least squares."""

    code = "E408"
    why = "the commanded motion says too little about the measured one"
    fix = "use --method auto"


# ---------------------------------------------------------------- 5: safety
class LimitBroken(DynidError):
    """A motion breaks a joint limit."""

    code = "E501"
    why = "the arm would stop or be damaged"
    fix = "use a smaller --alpha or smaller waypoints"


class Collision(DynidError):
    """A motion brings the arm into contact with itself or the floor."""

    code = "E502"
    why = "the arm would be damaged"
    fix = "change the waypoints or the seed"


class StartPoseOff(DynidError):
    """The arm is not at the trajectory's first pose."""

    code = "E503"
    why = "it would jump"
    fix = "run with --go-to-start: slow, checked, asks first"


class TrackingLost(DynidError):
    """The arm does not follow the commanded motion."""

    code = "E504"
    why = "something holds it, or it does not listen"
    fix = "look at the arm before trying again"


class NotReviewed(DynidError):
    """Nobody has confirmed this motion."""

    code = "E505"
    why = "an untested motion may be harmful"
    fix = "preview and accept it: dynid trajectory ROBOT --review FILE"


class StateStale(DynidError):
    """Joint states stopped coming while the arm moved."""

    code = "E506"
    why = "the motion of the arm is unknown"
    fix = "look at the driver and the network; the log up to there is kept"


class PacingLate(DynidError):
    """A command left this machine too late."""

    code = "E507"
    why = "the arm jerks when commands come in bursts"
    fix = "take load off this machine, or record from a quieter one"


class TorqueHigh(DynidError):
    """A joint's torque came near its rating."""

    code = "E508"
    why = "the arm pushes against something, or the motion is too fast"
    fix = "look at the arm; use --speed 50%, or plan with a smaller --alpha"


class PlanTeachesLittle(DynidError):
    """The best motion found excites so little that identification would refuse its log."""

    code = "E511"
    why = "a model identified from this motion would not predict other motions"
    fix = "give the search more time or room: --seconds, --duration, --segments, --floor none, thinner links"


class LimitsAssumed(DynidError):
    """The motion was planned with default limits, because the robot file has none."""

    code = "E512"
    why = "the arm's own limits may be lower"
    fix = "write `limits:` of every joint into the robot file (of a URDF: what dynid import makes) and plan again"


class GoalRefused(DynidError):
    """The arm's controller did not accept the motion, or gave it up."""

    code = "E509"
    why = "the controller has its own limits and tolerances"
    fix = "read the driver's output; use --speed 50%, or widen the controller's tolerances"


# ---------------------------------------------------------------- 6: machine
class RosMissing(DynidError):
    """rospy cannot be imported."""

    code = "E601"
    why = "record needs ROS 1, and rospy is not on PyPI"
    fix = "install ROS 1 (dynid doctor has the line), or record with 'rosbag record' and continue from the bag"


class MasterSilent(DynidError):
    """No ROS master answers."""

    code = "E602"
    why = "topics are found through the master"
    fix = "start one with: rosmaster --core (or roscore), or set ROS_MASTER_URI and ROS_IP"


class TopicSilent(DynidError):
    """The topic exists but no message arrives."""

    code = "E603"
    why = "the driver is not publishing"
    fix = "is the driver running, and the emergency stop released?"


class NoDisplay(DynidError):
    """A window was asked for but there is no display."""

    code = "E604"
    why = "PyBullet ends the process when it cannot open its window"
    fix = "use --preview picture"


class PackageMissing(DynidError):
    """A Python package is missing."""

    code = "E605"
    why = "this command needs it"
    fix = "install it with pip"


class CannotWrite(DynidError):
    """A file or folder cannot be written."""

    code = "E606"
    why = "the result would be lost"
    fix = "choose another folder with --out, or change its permissions"


class ServiceMissing(DynidError):
    """A service of the driver is missing or does not answer."""

    code = "E607"
    why = "without it the arm cannot be stopped, started or zeroed from here"
    fix = "is the driver running? use the physical stop button"


class SchedulerSilent(DynidError):
    """No Dask scheduler answers."""

    code = "E608"
    why = "its workers run the jobs"
    fix = "start it (dask scheduler), then the same command again: what is done is not done again"


class OutOfMemory(DynidError):
    """The machine has no memory left for what was asked."""

    code = "E611"
    why = "nothing more is written, because part of a log would give other numbers"
    fix = "give a shorter log or fewer effects, end other programs, or use another machine"


# ---------------------------------------------------------------- 7: decisions
class StaleCache(DynidError):
    """A model was made from another version of the robot file, and --frozen forbids to rebuild it."""

    code = "E701"
    why = "the numbers would belong to another robot"
    fix = "drop --frozen"


class OutputExists(DynidError):
    """The output exists and was made from other inputs."""

    code = "E702"
    why = "results are not overwritten without being asked to"
    fix = "use --force or another --out"


class CannotAsk(DynidError):
    """A question must be answered by a person, and there is no terminal."""

    code = "E703"
    why = "no answer is safe to assume"
    fix = "give the answer as an option"


class Declined(DynidError):
    """The person answered no, so nothing was done."""

    code = "E704"
    why = "nothing was written"
    fix = "run the command again when ready"
