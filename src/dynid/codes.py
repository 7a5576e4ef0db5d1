"""All codes of errors and warnings, and the page of each: ``dynid explain CODE`` and ``docs/reference/errors.md``."""

from __future__ import annotations

from dynid.errors import EXIT_MEANING, DynidError

WARNINGS: dict[str, str] = {
    "W202": "A DH angle was within 1e-4 rad of a multiple of 15 degrees and was snapped to it.",
    "W206": "Gravity points up in the world frame; say `mount: ceiling` when the arm hangs.",
    "W207": "A body of the robot file has an inertia that no distribution of mass has.",
    "W210": "The URDF lacks something or has it wrong: no mass, or an impossible inertia.",
    "W304": "The messages have no usable time stamps; the time of arrival in the bag is used.",
    "W305": "The bag was cut or not closed; what could be read was recovered.",
    "W308": "Measured velocity and the change of position agree only roughly; the derived velocity is better.",
    "W311": "Samples with the same time stamp as their predecessor were dropped.",
    "W312": "The log has gaps; the motion is cut there, not bridged.",
    "W313": "The log is short for the number of parameters; what it does not determine comes from the prior.",
    "W315": "A position jumped by a full turn and was unwrapped.",
    "W316": "A torque does not balance gravity at rest: the sensor was probably not zeroed.",
    "W319": "A torque stays at its largest value, or is not in the log: it is left out.",
    "W320": "The joint order was assumed because the file does not name its columns.",
    "W321": "Torques are stamped later or earlier than the positions they belong to.",
    "W323": "The stamps stray but the samples were taken evenly: an even clock is used.",
    "W324": "Torque spikes were replaced by the median of their neighbours.",
    "W325": "Samples repeat the one before them while the arm moves, as the driver held them; they are left out.",
    "W326": "The same recording was given twice; it counts once.",
    "W327": "Positions are so noisy that the cut-off is lowered for it, or that parameters are biased.",
    "W328": "The time stamps are not in seconds; they were converted.",
    "W329": "Another mapping of the columns explains the log far better; --anyway went on all the same.",
    "W330": "The names of the columns do not say which are positions and torques; give `driver: columns:`.",
    "W331": "Rows of a table without any number of a joint were left out: it holds something else as well.",
    "W332": "A joint moves beyond its limits: an offset, a direction or the limits in the robot file are wrong.",
    "W333": "No topic of a recording holds joint states: nothing can be identified from it.",
    "W334": "No edit of the robot file explains the torques of a joint: its friction would not brake with either sign.",
    "W335": "A table has torques of some joints and currents of all: only the torques are used.",
    "W402": "A base parameter is poorly excited by this log.",
    "W403": "The log determines fewer base parameters than the structure has; the rest comes from the prior.",
    "W404": "No physically consistent parameters near the prior fit the torques as well as least squares do.",
    "W405": "The mass matrix of least squares is not positive: too little motion, a missing effect, or a wrong sign.",
    "W406": "Many base parameters are not determined: they come from the prior, or hold for such motions only.",
    "W408": "An exported file gives other torques in the program that loaded it than here, or is refused there.",
    "W409": "Exported links have masses or inertias that no body has; simulators may refuse or replace them.",
    "W410": "A torque sensor behind the gear hardly measures rotor inertia and motor friction.",
    "W411": "A body on the last link does not explain what has changed between the two logs.",
    "W413": "The torques of a joint contradict those of the others: only a part, another scale or sign, or stuck.",
    "W501": "Torque sensors were not zeroed in this session.",
    "W604": "There is no display: the preview was saved as pictures instead.",
    "W606": "Limits that the robot file leaves out were assumed for the plan; `dynid record` refuses assumed rates.",
    "W605": "PyBullet is missing: distances were measured on capsules along the links, and the picture is a drawing.",
    "W608": "Even at full speed a log of the motion would predict other motions worse than one sample measures.",
}


def catalogue() -> dict[str, type[DynidError]]:
    """Return every mistake of the catalogue by its code."""
    return {cls.code: cls for cls in DynidError.__subclasses__()}


def codes() -> list[str]:
    """Return all codes, errors and warnings of a topic together."""
    return sorted([*catalogue(), *WARNINGS], key=lambda code: code[1:] + code)


def summary(code: str) -> str:
    """Return what happened, in one sentence."""
    return WARNINGS.get(code) or " ".join((catalogue()[code].__doc__ or "").split())


def page(code: str) -> dict[str, str]:
    """Return the parts of the page of a code: what, why, fix, exit; a warning has only what."""
    if code in WARNINGS:
        return {"what": summary(code)}
    mistake = catalogue()[code]
    return {
        "what": summary(code),
        "why": mistake.why,
        "fix": mistake.fix,
        "exit": f"{int(mistake.status)}, {EXIT_MEANING[mistake.status]}",
    }
