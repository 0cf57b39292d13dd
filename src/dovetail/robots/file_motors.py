"""Reader of a robot file's motors: torque limits, friction and rotors."""

from typing import TYPE_CHECKING

import numpy as np

from dovetail.robots.motors import Motors
from dovetail.robots.robot_file import RobotFile
from dovetail.robots.xml_file import listed

if TYPE_CHECKING:
    import mujoco


def read_torque_limits(model: "mujoco.MjModel") -> dict[str, float]:
    """Read torque limits from the joints or from the actuators that drive them."""
    import mujoco

    limits: dict[str, float] = {}
    for i in range(model.nu):
        if model.actuator_trntype[i] != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        joint = model.joint(int(model.actuator_trnid[i, 0])).name
        gear = abs(float(model.actuator_gear[i, 0]))
        is_motor = (
            model.actuator_gaintype[i] == int(mujoco.mjtGain.mjGAIN_FIXED)
            and model.actuator_biastype[i] == int(mujoco.mjtBias.mjBIAS_NONE)
            and model.actuator_dyntype[i] == int(mujoco.mjtDyn.mjDYN_NONE)
        )
        if model.actuator_forcelimited[i]:
            limits[joint] = gear * float(np.abs(model.actuator_forcerange[i]).min())
        elif is_motor and model.actuator_ctrllimited[i]:
            gain = gear * abs(float(model.actuator_gainprm[i, 0]))
            limits[joint] = gain * float(np.abs(model.actuator_ctrlrange[i]).min())
    for i in range(model.njnt):
        if model.jnt_actfrclimited[i]:
            limits[model.joint(i).name] = float(np.abs(model.jnt_actfrcrange[i]).min())
    return limits


def read_motors(
    model: "mujoco.MjModel", ids: list[int], names: list[str], file: RobotFile
) -> Motors:
    """Read friction and rotor inertia; what the file does not say is a default."""
    dofs = model.jnt_dofadr[ids]
    read = {
        "damping": np.array(model.dof_damping[dofs]),
        "armature": np.array(model.dof_armature[dofs]),
        "frictionloss": np.array(model.dof_frictionloss[dofs]),
    }
    usual, lacks = Motors(), []
    for fact in ("damping", "armature"):
        said = file.said.get(fact, frozenset())
        silent = [i for i, n in enumerate(names) if not said & {n, "*"}]
        read[fact][silent] = vars(usual)[fact][silent]
        if silent:
            unit = {"damping": "Nms/rad", "armature": "kg m2"}[fact]
            which = (
                "any joint" if len(silent) == 7 else listed([names[i] for i in silent])
            )
            lacks.append(
                f"{fact} of {which} ({vars(usual)[fact][0]:g} {unit} is assumed)"
            )
    notes = []
    if lacks:
        notes.append(
            f"{file.path.name} does not give the {' and the '.join(lacks)}; give "
            "motors=Motors(...) if you know better"
        )
    if model.dof_dampingpoly[dofs].any():
        notes.append(f"{file.path.name}: of a damping only the linear part is used")
    if model.nu and (model.actuator_armature.any() or model.actuator_damping.any()):
        notes.append(
            f"{file.path.name}: armature and damping of actuators are not used"
        )
    return Motors(
        damping=read["damping"],
        armature=read["armature"],
        coulomb=read["frictionloss"],
        notes=tuple(notes),
    )
