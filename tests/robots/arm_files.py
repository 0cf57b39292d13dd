"""Robot files for tests: an arm that loads, as URDF and as MJCF."""

TURNS = (0.0, -1.5707963, 1.5707963, 1.5707963, -1.5707963, 1.5707963, -1.5707963)
OFFSETS = ("0 0 0.3", "0 0 0", "0 -0.3 0", "0 0 0", "0 0.35 0", "0 0 0", "0 0.08 0")
COMS = ("0 0 0.05", "0 -0.1 0", "0 0 0.03", "0 0.1 0", "0 0 0.03", "0 0.02 0", "0 0 0")
MASSES = (4.0, 4.0, 3.0, 2.5, 2.0, 1.5, 0.5)
TORQUES = (250, 250, 120, 120, 80, 30, 30)


def urdf(*, inside="", extra="", inertia=None, kind="revolute", **limit):
    """A URDF of seven hinges.

    Args:
        inside: XML inside of the third joint.
        extra: XML before the end of the file.
        inertia: Moments (ixx, iyy, izz) of the fourth link.
        kind: Type of the sixth joint.
        limit: Attributes of every <limit> that are others.
    """
    lines = ['<robot name="arm">', '<link name="base"/>']
    for i in range(7):
        x, y, z = inertia if inertia and i == 3 else (0.02, 0.02, 0.02)
        lines.append(
            f'<link name="part{i + 1}"><inertial><origin xyz="{COMS[i]}"/>'
            f'<mass value="{MASSES[i]}"/><inertia ixx="{x}" iyy="{y}" izz="{z}" '
            'ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        facts = {"lower": -2.5, "upper": 2.5, "effort": TORQUES[i], "velocity": 1.2}
        words = " ".join(f'{k}="{v}"' for k, v in (facts | limit).items())
        lines.append(
            f'<joint name="axis{i + 1}" type="{kind if i == 5 else "revolute"}">'
            f'<parent link="{f"part{i}" if i else "base"}"/>'
            f'<child link="part{i + 1}"/><origin xyz="{OFFSETS[i]}" '
            f'rpy="{TURNS[i]} 0 0"/><axis xyz="0 0 1"/><limit {words}/>'
            f"{inside if i == 2 else ''}</joint>"
        )
    return "\n".join([*lines, extra, "</robot>"])


def mjcf(*, joint="", body="", top="", last="", inertial=True):
    """An MJCF file of seven hinges.

    Args:
        joint: Attributes of every joint, by way of the default.
        body: XML inside of the third body.
        top: XML before the bodies.
        last: XML after them.
        inertial: Whether the third body has an <inertial>.
    """
    lines = ['<mujoco model="arm">', '<compiler angle="radian"/>']
    lines += [
        f'<default><joint range="-2.5 2.5" actuatorfrcrange="-90 90" {joint}/>',
        "</default>",
        top,
        "<worldbody>",
    ]
    for i in range(7):
        mass = f'<inertial pos="{COMS[i]}" mass="{MASSES[i]}" diaginertia="1 1 1"/>'
        lines.append(
            f'<body name="part{i + 1}" pos="{OFFSETS[i]}" euler="{TURNS[i]} 0 0">'
            f"{mass.replace('1 1 1', '.02 .02 .02') if inertial or i != 2 else ''}"
            f'<joint name="axis{i + 1}"/>{body if i == 2 else ""}'
        )
    return "\n".join([*lines, "</body>" * 7, "</worldbody>", last, "</mujoco>"])
