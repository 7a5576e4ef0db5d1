"""Commands on simulated arms: simulate, sim-driver."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import TIP, Existing, dynid_command
from dynid.cli.prompt import may_write
from dynid.cli.session import Session
from dynid.disk import sha256
from dynid.drivers.ros import raise_priority
from dynid.judgement.rules import Step
from dynid.options import option
from dynid.runs import RunFolder
from dynid.sim.options import SimDriverOptions
from dynid.text import shell
from dynid.workflows.options import SimulateOptions

if TYPE_CHECKING:
    from dynid.robot import Robot


@dynid_command("simulate")
def simulate_command(
    session: Session,
    *,
    robot: str,
    trajectory: Existing,
    options: SimulateOptions,
    compare: Existing | None = option(
        None,
        "Drive the exported files of the two arguments, results of one arm, along this log and show the errors.",
        metavar="LOG",
    ),
    tip: str | None = TIP,
    engine: str = option(
        "mujoco", "Simulator that --compare loads the exported files in.", choices=("mujoco",)
    ),
) -> Answer:
    """Simulate the log of an arm that follows a motion: friction, noise, effects; no ROS is needed.

    Examples:
      dynid simulate ur5e out/ur5e/trajectory.npz
      dynid simulate my_arm.yaml trajectory.npz --payload 2 --delay 0.004
      dynid simulate my_arm.yaml trajectory.npz --effect torque_offset@2:c=3
      dynid simulate out/before out/after --compare run3.bag     exported files in MuJoCo, compared with a log
    """
    if compare is not None:
        gap = dynid.compare_in_simulator([robot, trajectory], compare)
        folder = session.out or RunFolder.of(trajectory).path
        picture = folder / "simulator" / f"{compare.stem}_{gap.engine}.png"
        return replace(gap.answer(), wrote=[workflows.simulate.save_figure(gap, picture)])
    arm = dynid.load_robot(robot, tip=tip)
    target = session.folder(arm.slug) / "simulated.npz"
    inputs = {"robot": arm.model_key, "motion": sha256(trajectory), **options.texts()}
    simulation = dynid.simulate(arm, trajectory, options)
    new = may_write(session, target, inputs)
    wrote = [simulation.log.save(target, session.header(inputs))] if new else []
    steps = [Step("", f"dynid identify {arm.word} {shell(target)}")]
    return replace(simulation.answer(), wrote=wrote, next=steps)


@dynid_command("sim-driver")
def sim_driver_command(session: Session, *, robot: Robot, options: SimDriverOptions) -> Answer:
    """Simulate an arm behind its driver's topics, in real time.

    Examples:
      rosmaster --core &                       a ROS master, if none runs
      dynid sim-driver kinova_gen2 --pose out/kinova_gen2/trajectory.npz
      dynid sim-driver kuka_lwr4plus --rate 200 --torque-noise 0.1 --latency 0.005
    """
    raise_priority()
    return workflows.simulate.simulate_driver(robot, options)
