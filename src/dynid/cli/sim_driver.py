"""``dynid sim-driver ROBOT``: a simulated arm behind the very topics of its driver, to rehearse a recording with."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import dynid
from dynid import workflows
from dynid.cli.arguments import options_from, options_of, robot_argument
from dynid.cli.options import Common, dynid_command
from dynid.drivers.ros import raise_priority
from dynid.errors import ExitStatus
from dynid.workflows.options import SimDriverOptions

if TYPE_CHECKING:
    from dynid.workflows.sim_driver import DriverRun


@dynid_command(
    "sim-driver",
    examples=(
        "rosmaster --core &                       a ROS master, if none runs",
        "dynid sim-driver kinova_gen2 --pose out/kinova_gen2/trajectory.npz",
        "dynid sim-driver kuka_lwr4plus --rate 200 --torque-noise 0.1 --latency 0.005",
    ),
)
@robot_argument
@options_from(SimDriverOptions, without=("seed",))
def command(common: Common, robot: str, **values: Any) -> ExitStatus:  # noqa: ANN401
    """Simulate an arm behind its driver's topics, in real time."""
    import signal

    arm, options = dynid.load_robot(robot), options_of(SimDriverOptions, values, seed=common.seed)

    def started(topic: str, master: str) -> None:
        common.terminal.stage(
            "driver", f"{topic} at {options.rate:g} Hz, master {master}, seed {common.seed}"
        )
        common.terminal.stage(
            "stop", "Ctrl-C" if options.duration is None else f"after {options.duration:g} s"
        )
        # Why: a shell that started this in the background has it ignore Ctrl-C; it is ended with kill then.
        signal.signal(signal.SIGTERM, signal.default_int_handler)

    raise_priority()
    done = workflows.sim_driver.simulate_driver(arm, options, started=started)
    if done.interrupted:
        common.terminal.detail("stop", "interrupted")
    show(common, done)
    return ExitStatus.DONE


def show(common: Common, done: DriverRun) -> None:
    """Say what was published, and how much of the limits the arm used."""
    terminal, facts = common.terminal, done.facts()
    terminal.emit_json(facts)
    terminal.fact("published", f"{facts['published']} joint states, {facts['dropped']} dropped")
    if facts["stop_acceleration_share"]:
        share = 100 * facts["stop_acceleration_share"]
        terminal.fact(
            "stops",
            f"braking took {share:.0f} % of the acceleration limits; this driver brakes as it can",
        )
