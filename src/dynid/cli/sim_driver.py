"""``dynid sim-driver ROBOT``: a simulated arm behind the very topics of its driver, to rehearse a recording with."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import dynid_command, options_from, robot_argument
from dynid.cli.session import Session
from dynid.drivers.ros import raise_priority
from dynid.workflows.options import SimDriverOptions

if TYPE_CHECKING:
    from dynid.robot import Robot


@dynid_command(
    "sim-driver",
    examples=(
        "rosmaster --core &                       a ROS master, if none runs",
        "dynid sim-driver kinova_gen2 --pose out/kinova_gen2/trajectory.npz",
        "dynid sim-driver kuka_lwr4plus --rate 200 --torque-noise 0.1 --latency 0.005",
    ),
)
@robot_argument
@options_from(SimDriverOptions)
def command(session: Session, robot: Robot, options: SimDriverOptions) -> Answer:
    """Simulate an arm behind its driver's topics, in real time."""

    def started(topic: str, master: str) -> None:
        where = f"{topic} at {options.rate:g} Hz, master {master}, seed {session.seed}"
        session.stage("driver", where)
        end = "Ctrl-C" if options.duration is None else f"after {options.duration:g} s"
        session.stage("stop", end)
        # Why: a shell that started this in the background has it ignore Ctrl-C; it is ended with kill then.
        signal.signal(signal.SIGTERM, signal.default_int_handler)

    raise_priority()
    return workflows.sim_driver.simulate_driver(robot, options, started=started)
