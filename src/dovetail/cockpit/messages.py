"""The messages that a browser may send to a page, and the values they can carry."""

from typing import Annotated, Any, Literal

import msgspec

_Name = Annotated[str, msgspec.Meta(max_length=64)]
_Word = Annotated[str, msgspec.Meta(max_length=500)]
_Number = Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)]
_Three = tuple[_Number, _Number, _Number]
_Four = tuple[_Number, _Number, _Number, _Number]
_Far = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]


class _Sent(msgspec.Struct, forbid_unknown_fields=True):
    """A message of viser's page; its `type` is viser's name of it."""


class CameraMoved(_Sent, tag="ViewerCameraMessage"):
    """A viewer looks from elsewhere."""

    wxyz: _Four
    position: _Three
    look_at: _Three
    up_direction: _Three
    fov: _Far
    near: _Far
    far: _Far
    image_height: _Far
    image_width: _Far


class NewValue(msgspec.Struct, forbid_unknown_fields=True):
    """The only attribute of a control that a browser may set."""

    value: bool | float | _Word


class ControlUsed(_Sent, tag="GuiUpdateMessage"):
    """A button was pressed, or another value was chosen."""

    uuid: _Name
    updates: NewValue


class KeyPressed(_Sent, tag="CommandTriggerMessage"):
    """The key of a command was pressed."""

    uuid: _Name


class DragBegun(_Sent, tag="TransformControlsDragStartMessage"):
    """A gizmo was grabbed."""

    name: _Name
    owner: Literal[""]


class Dragged(_Sent, tag="TransformControlsUpdateMessage"):
    """A gizmo was moved [m]."""

    name: _Name
    owner: Literal[""]
    position: _Three
    wxyz: _Four


class DragEnded(_Sent, tag="TransformControlsDragEndMessage"):
    """A gizmo was let go."""

    name: _Name
    owner: Literal[""]


Message = CameraMoved | ControlUsed | KeyPressed | DragBegun | Dragged | DragEnded

_DECODER = msgspec.msgpack.Decoder(Message)
_ENCODER = msgspec.msgpack.Encoder()


def read_message(raw: object) -> Message | None:
    """Return a message that a browser may send; None for everything else."""
    if not isinstance(raw, bytes):
        return None
    try:
        return _DECODER.decode(raw)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
        return None


def write_message(message: Message) -> bytes:
    """Return the bytes that viser reads: they hold what was checked, and no more."""
    return _ENCODER.encode(message)


def can_have(control: Any, value: bool | float | str) -> bool:
    """Return whether a browser can give this value to this control.

    Kinds of controls that no page here has are refused.
    """
    import viser

    if control is None or control.disabled or not control.visible:
        return False
    if isinstance(control, viser.GuiButtonHandle):
        return value is True
    if isinstance(control, viser.GuiButtonGroupHandle | viser.GuiDropdownHandle):
        return isinstance(value, str) and value in control.options
    if isinstance(control, viser.GuiSliderHandle):
        return isinstance(value, float) and control.min <= value <= control.max
    return False
