from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Version(_message.Message):
    __slots__ = ("protocol", "package")
    PROTOCOL_FIELD_NUMBER: _ClassVar[int]
    PACKAGE_FIELD_NUMBER: _ClassVar[int]
    protocol: int
    package: str
    def __init__(self, protocol: _Optional[int] = ..., package: _Optional[str] = ...) -> None: ...

class InfoRequest(_message.Message):
    __slots__ = ("version",)
    VERSION_FIELD_NUMBER: _ClassVar[int]
    version: Version
    def __init__(self, version: _Optional[_Union[Version, _Mapping]] = ...) -> None: ...

class Info(_message.Message):
    __slots__ = ("version", "arm", "real_time", "robot", "cell", "holder", "stopped", "joints", "columns", "configured", "places_fixture")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    ARM_FIELD_NUMBER: _ClassVar[int]
    REAL_TIME_FIELD_NUMBER: _ClassVar[int]
    ROBOT_FIELD_NUMBER: _ClassVar[int]
    CELL_FIELD_NUMBER: _ClassVar[int]
    HOLDER_FIELD_NUMBER: _ClassVar[int]
    STOPPED_FIELD_NUMBER: _ClassVar[int]
    JOINTS_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    CONFIGURED_FIELD_NUMBER: _ClassVar[int]
    PLACES_FIXTURE_FIELD_NUMBER: _ClassVar[int]
    version: Version
    arm: str
    real_time: bool
    robot: RobotModel
    cell: Workcell
    holder: str
    stopped: str
    joints: _containers.RepeatedScalarFieldContainer[str]
    columns: _containers.RepeatedScalarFieldContainer[str]
    configured: Configuration
    places_fixture: bool
    def __init__(self, version: _Optional[_Union[Version, _Mapping]] = ..., arm: _Optional[str] = ..., real_time: _Optional[bool] = ..., robot: _Optional[_Union[RobotModel, _Mapping]] = ..., cell: _Optional[_Union[Workcell, _Mapping]] = ..., holder: _Optional[str] = ..., stopped: _Optional[str] = ..., joints: _Optional[_Iterable[str]] = ..., columns: _Optional[_Iterable[str]] = ..., configured: _Optional[_Union[Configuration, _Mapping]] = ..., places_fixture: _Optional[bool] = ...) -> None: ...

class RobotModel(_message.Message):
    __slots__ = ("name", "origin_position", "origin_rotation", "mass", "com", "inertia", "flange_position", "flange_rotation", "tool_position", "tool_rotation", "q_min", "q_max", "dq_max", "tau_max", "payload", "damping", "armature", "taper_brake", "taper_offset", "dtau_max")
    NAME_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_POSITION_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_ROTATION_FIELD_NUMBER: _ClassVar[int]
    MASS_FIELD_NUMBER: _ClassVar[int]
    COM_FIELD_NUMBER: _ClassVar[int]
    INERTIA_FIELD_NUMBER: _ClassVar[int]
    FLANGE_POSITION_FIELD_NUMBER: _ClassVar[int]
    FLANGE_ROTATION_FIELD_NUMBER: _ClassVar[int]
    TOOL_POSITION_FIELD_NUMBER: _ClassVar[int]
    TOOL_ROTATION_FIELD_NUMBER: _ClassVar[int]
    Q_MIN_FIELD_NUMBER: _ClassVar[int]
    Q_MAX_FIELD_NUMBER: _ClassVar[int]
    DQ_MAX_FIELD_NUMBER: _ClassVar[int]
    TAU_MAX_FIELD_NUMBER: _ClassVar[int]
    PAYLOAD_FIELD_NUMBER: _ClassVar[int]
    DAMPING_FIELD_NUMBER: _ClassVar[int]
    ARMATURE_FIELD_NUMBER: _ClassVar[int]
    TAPER_BRAKE_FIELD_NUMBER: _ClassVar[int]
    TAPER_OFFSET_FIELD_NUMBER: _ClassVar[int]
    DTAU_MAX_FIELD_NUMBER: _ClassVar[int]
    name: str
    origin_position: _containers.RepeatedScalarFieldContainer[float]
    origin_rotation: _containers.RepeatedScalarFieldContainer[float]
    mass: _containers.RepeatedScalarFieldContainer[float]
    com: _containers.RepeatedScalarFieldContainer[float]
    inertia: _containers.RepeatedScalarFieldContainer[float]
    flange_position: _containers.RepeatedScalarFieldContainer[float]
    flange_rotation: _containers.RepeatedScalarFieldContainer[float]
    tool_position: _containers.RepeatedScalarFieldContainer[float]
    tool_rotation: _containers.RepeatedScalarFieldContainer[float]
    q_min: _containers.RepeatedScalarFieldContainer[float]
    q_max: _containers.RepeatedScalarFieldContainer[float]
    dq_max: _containers.RepeatedScalarFieldContainer[float]
    tau_max: _containers.RepeatedScalarFieldContainer[float]
    payload: Payload
    damping: _containers.RepeatedScalarFieldContainer[float]
    armature: _containers.RepeatedScalarFieldContainer[float]
    taper_brake: _containers.RepeatedScalarFieldContainer[float]
    taper_offset: _containers.RepeatedScalarFieldContainer[float]
    dtau_max: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, name: _Optional[str] = ..., origin_position: _Optional[_Iterable[float]] = ..., origin_rotation: _Optional[_Iterable[float]] = ..., mass: _Optional[_Iterable[float]] = ..., com: _Optional[_Iterable[float]] = ..., inertia: _Optional[_Iterable[float]] = ..., flange_position: _Optional[_Iterable[float]] = ..., flange_rotation: _Optional[_Iterable[float]] = ..., tool_position: _Optional[_Iterable[float]] = ..., tool_rotation: _Optional[_Iterable[float]] = ..., q_min: _Optional[_Iterable[float]] = ..., q_max: _Optional[_Iterable[float]] = ..., dq_max: _Optional[_Iterable[float]] = ..., tau_max: _Optional[_Iterable[float]] = ..., payload: _Optional[_Union[Payload, _Mapping]] = ..., damping: _Optional[_Iterable[float]] = ..., armature: _Optional[_Iterable[float]] = ..., taper_brake: _Optional[_Iterable[float]] = ..., taper_offset: _Optional[_Iterable[float]] = ..., dtau_max: _Optional[_Iterable[float]] = ...) -> None: ...

class Payload(_message.Message):
    __slots__ = ("mass", "com", "inertia")
    MASS_FIELD_NUMBER: _ClassVar[int]
    COM_FIELD_NUMBER: _ClassVar[int]
    INERTIA_FIELD_NUMBER: _ClassVar[int]
    mass: float
    com: _containers.RepeatedScalarFieldContainer[float]
    inertia: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, mass: _Optional[float] = ..., com: _Optional[_Iterable[float]] = ..., inertia: _Optional[_Iterable[float]] = ...) -> None: ...

class Workcell(_message.Message):
    __slots__ = ("name",)
    NAME_FIELD_NUMBER: _ClassVar[int]
    name: str
    def __init__(self, name: _Optional[str] = ...) -> None: ...

class LeaseRequest(_message.Message):
    __slots__ = ("version", "client")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    CLIENT_FIELD_NUMBER: _ClassVar[int]
    version: Version
    client: str
    def __init__(self, version: _Optional[_Union[Version, _Mapping]] = ..., client: _Optional[str] = ...) -> None: ...

class Holder(_message.Message):
    __slots__ = ("lease",)
    LEASE_FIELD_NUMBER: _ClassVar[int]
    lease: str
    def __init__(self, lease: _Optional[str] = ...) -> None: ...

class Done(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class Configuration(_message.Message):
    __slots__ = ("lease", "version", "task", "period", "osc", "limits", "cell")
    LEASE_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    TASK_FIELD_NUMBER: _ClassVar[int]
    PERIOD_FIELD_NUMBER: _ClassVar[int]
    OSC_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    CELL_FIELD_NUMBER: _ClassVar[int]
    lease: str
    version: Version
    task: str
    period: float
    osc: _containers.RepeatedCompositeFieldContainer[Setting]
    limits: _containers.RepeatedCompositeFieldContainer[Setting]
    cell: Workcell
    def __init__(self, lease: _Optional[str] = ..., version: _Optional[_Union[Version, _Mapping]] = ..., task: _Optional[str] = ..., period: _Optional[float] = ..., osc: _Optional[_Iterable[_Union[Setting, _Mapping]]] = ..., limits: _Optional[_Iterable[_Union[Setting, _Mapping]]] = ..., cell: _Optional[_Union[Workcell, _Mapping]] = ...) -> None: ...

class Setting(_message.Message):
    __slots__ = ("name", "numbers", "is_on", "choice")
    NAME_FIELD_NUMBER: _ClassVar[int]
    NUMBERS_FIELD_NUMBER: _ClassVar[int]
    IS_ON_FIELD_NUMBER: _ClassVar[int]
    CHOICE_FIELD_NUMBER: _ClassVar[int]
    name: str
    numbers: _containers.RepeatedScalarFieldContainer[float]
    is_on: bool
    choice: str
    def __init__(self, name: _Optional[str] = ..., numbers: _Optional[_Iterable[float]] = ..., is_on: _Optional[bool] = ..., choice: _Optional[str] = ...) -> None: ...

class Pose(_message.Message):
    __slots__ = ("position", "quat_wxyz")
    POSITION_FIELD_NUMBER: _ClassVar[int]
    QUAT_WXYZ_FIELD_NUMBER: _ClassVar[int]
    position: _containers.RepeatedScalarFieldContainer[float]
    quat_wxyz: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, position: _Optional[_Iterable[float]] = ..., quat_wxyz: _Optional[_Iterable[float]] = ...) -> None: ...

class ResetRequest(_message.Message):
    __slots__ = ("lease", "q", "fixture", "seed")
    LEASE_FIELD_NUMBER: _ClassVar[int]
    Q_FIELD_NUMBER: _ClassVar[int]
    FIXTURE_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    lease: str
    q: _containers.RepeatedScalarFieldContainer[float]
    fixture: Pose
    seed: int
    def __init__(self, lease: _Optional[str] = ..., q: _Optional[_Iterable[float]] = ..., fixture: _Optional[_Union[Pose, _Mapping]] = ..., seed: _Optional[int] = ...) -> None: ...

class Target(_message.Message):
    __slots__ = ("f_star", "position_d", "quat_wxyz_d", "q_d", "near_plane", "velocity_d", "acceleration_d", "age", "stay", "f_tare")
    F_STAR_FIELD_NUMBER: _ClassVar[int]
    POSITION_D_FIELD_NUMBER: _ClassVar[int]
    QUAT_WXYZ_D_FIELD_NUMBER: _ClassVar[int]
    Q_D_FIELD_NUMBER: _ClassVar[int]
    NEAR_PLANE_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_D_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_D_FIELD_NUMBER: _ClassVar[int]
    AGE_FIELD_NUMBER: _ClassVar[int]
    STAY_FIELD_NUMBER: _ClassVar[int]
    F_TARE_FIELD_NUMBER: _ClassVar[int]
    f_star: _containers.RepeatedScalarFieldContainer[float]
    position_d: _containers.RepeatedScalarFieldContainer[float]
    quat_wxyz_d: _containers.RepeatedScalarFieldContainer[float]
    q_d: _containers.RepeatedScalarFieldContainer[float]
    near_plane: _containers.RepeatedScalarFieldContainer[float]
    velocity_d: _containers.RepeatedScalarFieldContainer[float]
    acceleration_d: _containers.RepeatedScalarFieldContainer[float]
    age: float
    stay: int
    f_tare: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, f_star: _Optional[_Iterable[float]] = ..., position_d: _Optional[_Iterable[float]] = ..., quat_wxyz_d: _Optional[_Iterable[float]] = ..., q_d: _Optional[_Iterable[float]] = ..., near_plane: _Optional[_Iterable[float]] = ..., velocity_d: _Optional[_Iterable[float]] = ..., acceleration_d: _Optional[_Iterable[float]] = ..., age: _Optional[float] = ..., stay: _Optional[int] = ..., f_tare: _Optional[_Iterable[float]] = ...) -> None: ...

class StepRequest(_message.Message):
    __slots__ = ("lease", "counter", "target", "duration", "acquire")
    LEASE_FIELD_NUMBER: _ClassVar[int]
    COUNTER_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    ACQUIRE_FIELD_NUMBER: _ClassVar[int]
    lease: str
    counter: int
    target: Target
    duration: float
    acquire: LeaseRequest
    def __init__(self, lease: _Optional[str] = ..., counter: _Optional[int] = ..., target: _Optional[_Union[Target, _Mapping]] = ..., duration: _Optional[float] = ..., acquire: _Optional[_Union[LeaseRequest, _Mapping]] = ...) -> None: ...

class ArmState(_message.Message):
    __slots__ = ("stamp", "q", "dq", "position", "quat_wxyz", "velocity", "contact_force", "flags", "log", "wrench", "parts")
    STAMP_FIELD_NUMBER: _ClassVar[int]
    Q_FIELD_NUMBER: _ClassVar[int]
    DQ_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    QUAT_WXYZ_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FIELD_NUMBER: _ClassVar[int]
    CONTACT_FORCE_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    LOG_FIELD_NUMBER: _ClassVar[int]
    WRENCH_FIELD_NUMBER: _ClassVar[int]
    PARTS_FIELD_NUMBER: _ClassVar[int]
    stamp: float
    q: _containers.RepeatedScalarFieldContainer[float]
    dq: _containers.RepeatedScalarFieldContainer[float]
    position: _containers.RepeatedScalarFieldContainer[float]
    quat_wxyz: _containers.RepeatedScalarFieldContainer[float]
    velocity: _containers.RepeatedScalarFieldContainer[float]
    contact_force: _containers.RepeatedScalarFieldContainer[float]
    flags: int
    log: bytes
    wrench: _containers.RepeatedScalarFieldContainer[float]
    parts: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, stamp: _Optional[float] = ..., q: _Optional[_Iterable[float]] = ..., dq: _Optional[_Iterable[float]] = ..., position: _Optional[_Iterable[float]] = ..., quat_wxyz: _Optional[_Iterable[float]] = ..., velocity: _Optional[_Iterable[float]] = ..., contact_force: _Optional[_Iterable[float]] = ..., flags: _Optional[int] = ..., log: _Optional[bytes] = ..., wrench: _Optional[_Iterable[float]] = ..., parts: _Optional[_Iterable[float]] = ...) -> None: ...

class Report(_message.Message):
    __slots__ = ("counter", "state", "problem", "holder", "stopped", "lease")
    COUNTER_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    HOLDER_FIELD_NUMBER: _ClassVar[int]
    STOPPED_FIELD_NUMBER: _ClassVar[int]
    LEASE_FIELD_NUMBER: _ClassVar[int]
    counter: int
    state: ArmState
    problem: Problem
    holder: str
    stopped: str
    lease: str
    def __init__(self, counter: _Optional[int] = ..., state: _Optional[_Union[ArmState, _Mapping]] = ..., problem: _Optional[_Union[Problem, _Mapping]] = ..., holder: _Optional[str] = ..., stopped: _Optional[str] = ..., lease: _Optional[str] = ...) -> None: ...

class Problem(_message.Message):
    __slots__ = ("kind", "text", "fields", "reason")
    KIND_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    FIELDS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    kind: str
    text: str
    fields: _containers.RepeatedCompositeFieldContainer[FieldProblem]
    reason: str
    def __init__(self, kind: _Optional[str] = ..., text: _Optional[str] = ..., fields: _Optional[_Iterable[_Union[FieldProblem, _Mapping]]] = ..., reason: _Optional[str] = ...) -> None: ...

class FieldProblem(_message.Message):
    __slots__ = ("path", "value", "allowed")
    PATH_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    ALLOWED_FIELD_NUMBER: _ClassVar[int]
    path: str
    value: str
    allowed: str
    def __init__(self, path: _Optional[str] = ..., value: _Optional[str] = ..., allowed: _Optional[str] = ...) -> None: ...

class WatchRequest(_message.Message):
    __slots__ = ("version", "log", "interval")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    LOG_FIELD_NUMBER: _ClassVar[int]
    INTERVAL_FIELD_NUMBER: _ClassVar[int]
    version: Version
    log: bool
    interval: float
    def __init__(self, version: _Optional[_Union[Version, _Mapping]] = ..., log: _Optional[bool] = ..., interval: _Optional[float] = ...) -> None: ...

class StopRequest(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class LogRequest(_message.Message):
    __slots__ = ("version", "lease")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    LEASE_FIELD_NUMBER: _ClassVar[int]
    version: Version
    lease: str
    def __init__(self, version: _Optional[_Union[Version, _Mapping]] = ..., lease: _Optional[str] = ...) -> None: ...

class LogChunk(_message.Message):
    __slots__ = ("columns", "step", "rows", "dropped")
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    DROPPED_FIELD_NUMBER: _ClassVar[int]
    columns: _containers.RepeatedScalarFieldContainer[str]
    step: int
    rows: bytes
    dropped: int
    def __init__(self, columns: _Optional[_Iterable[str]] = ..., step: _Optional[int] = ..., rows: _Optional[bytes] = ..., dropped: _Optional[int] = ...) -> None: ...
