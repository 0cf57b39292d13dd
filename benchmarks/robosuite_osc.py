"""Robosuite's operational-space controller behind a pipe, for `tracking.py`.

Run by an interpreter that has robosuite (1.5.2 with mujoco 3.3.0), not by dovetail's.
The maths is robosuite's own class, OperationalSpaceController, over robosuite's own
MjSim; here it is only given the model and, in every cycle, the measured state. Gravity
is off in its model: the plant compensates gravity below every law alike.

    argument   folder with model.xml and model.npz (masses, inertias, armature)
    request    20 doubles: q, dq, goal position [m], goal rotation vector [rad]
    reset      20 doubles: NaN, kp, damping ratio, then q of the posture at [7:14]
    answer     7 doubles: torque [Nm], zero for a reset
"""

# pyright: reportMissingImports=false
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from robosuite.controllers.parts.arm.osc import OperationalSpaceController
from robosuite.utils.binding_utils import MjSim

REQUEST, BYTES = 20, 8


def build_sim(folder: Path) -> MjSim:
    """Load the nominal arm into robosuite's simulation object."""
    sim = MjSim.from_xml_string((folder / "model.xml").read_text())
    model = sim.model._model
    for name, values in np.load(folder / "model.npz").items():
        getattr(model, name)[:] = values
    model.body_sameframe[:] = 0  # masses are not where the XML has them
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    mujoco.mj_setConst(model, sim.data._data)
    return sim


def put_state(sim: MjSim, q: np.ndarray, dq: np.ndarray) -> None:
    """Compute everything that the controller reads at this state."""
    sim.data.qpos[:], sim.data.qvel[:] = q, dq
    sim.forward()


def build_controller(sim: MjSim, kp: float, damping: float, q: np.ndarray) -> object:
    """Build the controller with its posture at q, absolute goals in the world."""
    put_state(sim, q, np.zeros(7))
    joints = list(range(7))
    controller = OperationalSpaceController(
        sim,
        ref_name="tcp",
        joint_indexes={"joints": joints, "qpos": joints, "qvel": joints},
        actuator_range=(np.full(7, -np.inf), np.full(7, np.inf)),
        kp=kp,
        damping_ratio=damping,
        input_type="absolute",
        input_ref_frame="world",
        part_name="right",
        naming_prefix="robot0_",
    )
    controller.update_initial_joints(q)
    return controller


def main() -> None:
    """Answer until the pipe is closed."""
    sim = build_sim(Path(sys.argv[1]))
    controller: Any = None
    source, sink = sys.stdin.buffer, sys.stdout.buffer
    while len(data := source.read(REQUEST * BYTES)) == REQUEST * BYTES:
        row = np.frombuffer(data)
        tau = np.zeros(7)
        if np.isnan(row[0]):
            controller = build_controller(sim, row[1], row[2], row[7:14].copy())
        else:
            put_state(sim, row[:7], row[7:14])
            controller.set_goal(row[14:].copy())
            tau = np.asarray(controller.run_controller(), dtype=float)
        sink.write(tau.tobytes())
        sink.flush()


if __name__ == "__main__":
    main()
