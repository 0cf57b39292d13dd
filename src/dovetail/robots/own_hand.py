"""A hand that a robot file has beyond the arm; the cell's tool takes its place."""

from typing import TYPE_CHECKING, Any

from dovetail.robots.robot_file import RobotFile

if TYPE_CHECKING:
    import mujoco


def leave_hand_out(spec: "mujoco.MjSpec", file: RobotFile, last: str) -> list[str]:
    """Delete what moves beyond the seventh joint, with the body that carries it.

    Args:
        spec: The file, each joint with a name.
        file: Its path, for the note.
        last: Name of the seventh joint.

    Returns:
        A note, if there is one. A site where each hand was stands for the flange.
    """
    link = next(joint.parent for joint in spec.joints if joint.name == last)
    hands = [_palm(child) for child in link.bodies if _moves(child)]
    if not hands:
        return []
    names = [hand.name or f"unnamed body {i}" for i, hand in enumerate(hands, 1)]
    weight = _weight(hands)
    for name, hand in zip(names, hands, strict=True):
        mount = hand.parent.add_site(name=f"mount of {name}", pos=hand.pos)
        mount.quat, mount.alt = hand.quat, hand.alt
        spec.delete(hand)
    return [
        f"{file.path.name}: {', '.join(names)}{weight} moves beyond the seventh joint "
        "and is left out: the cell's tool takes its place"
    ]


def _moves(body: Any) -> bool:
    return bool(list(body.joints)) or any(_moves(child) for child in body.bodies)


def _palm(body: Any) -> Any:
    """Return the body that a hand begins with; one that weighs nothing is a frame."""
    moving = [child for child in body.bodies if _moves(child)]
    while len(moving) == 1 and not list(body.joints) and not body.mass:
        body = moving[0]
        moving = [child for child in body.bodies if _moves(child)]
    return body


def _weight(bodies: list[Any]) -> str:
    """Return the mass of bodies in brackets; nothing if their shapes give it."""
    mass, left = 0.0, list(bodies)
    while left:
        body = left.pop()
        if list(body.geoms) and not body.explicitinertial:
            return ""
        mass += float(body.mass) if body.explicitinertial else 0.0
        left += body.bodies
    return f" ({mass:.3g} kg)"
