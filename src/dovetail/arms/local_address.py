"""Arms of this process: an ideal plant, or a twin."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.local_arm import LocalArm
from dovetail.control.settings import ControllerSettings
from dovetail.errors import ConfigError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DrivenPlant, DynamicsConfig
from dovetail.plants.twin import Twin, load_twin, make_twin

if TYPE_CHECKING:
    from dovetail.workcell.workcell import Workcell


@dataclass(frozen=True, kw_only=True)
class LocalAddress(ArmAddress):
    """A controller over a plant, both here."""

    is_here: ClassVar[bool] = True

    @property
    def is_real_time(self) -> bool:
        """False: the arm stands still while the learner thinks."""
        return False

    @property
    def may_be_robot(self) -> bool:
        """False: no real arm moves there."""
        return False

    @property
    def can_be_disturbed(self) -> bool:
        """True: the simulation is here."""
        return True

    @abstractmethod
    def make_plant(self, cell: "Workcell") -> DrivenPlant:
        """Build the simulation."""

    def build(self, cell: "Workcell", settings: ControllerSettings) -> LocalArm:
        """Build the plant, and the controller over it."""
        return LocalArm(
            self.make_plant(cell),
            cell.loaded_robot(),
            settings.osc,
            settings.limits,
            settings.task,
            settings.period,
            address=self.text,
        )


@dataclass(frozen=True, kw_only=True)
class PlantAddress(LocalAddress):
    """An ideal plant in this process."""

    engine: str
    """Physics engine: mujoco, bullet or drake."""
    dynamics: DynamicsConfig | None = None
    """Its physics; None is as the model says."""

    def with_dynamics(self, dynamics: DynamicsConfig) -> Self:
        """Return the address of the plant with other physics."""
        return replace(self, dynamics=dynamics)

    def describe_ground(self) -> str:
        """Return where a result was found."""
        return f"simulation ({self.engine})"

    def make_plant(self, cell: "Workcell") -> DrivenPlant:
        """Build the simulation."""
        return make_plant(self.engine, cell, self.dynamics)


@dataclass(frozen=True, kw_only=True)
class TwinAddress(LocalAddress):
    """A twin in this process."""

    config: Twin | str | Path
    """The twin: itself, a shipped one's name, or the path of a .toml file."""
    engine: str | None = None
    """Another physics engine than the twin's."""

    @property
    def twin(self) -> str:
        """Name or file of the twin; empty where it was given itself."""
        return "" if isinstance(self.config, Twin) else str(self.config)

    def with_engine(self, engine: str) -> Self:
        """Return the address of the twin in another physics engine."""
        return replace(self, engine=engine)

    def with_dynamics(self, dynamics: DynamicsConfig) -> Self:
        """Refuse it: a twin has its own."""
        raise ConfigError("dynamics and twin exclude each other: a twin has its own")

    def describe_ground(self) -> str:
        """Return where a result was found: a twin is called a twin, never a robot."""
        name = Path(self.twin).stem or "given"
        return f"twin {name} ({self.engine or load_twin(self.config).engine})"

    def make_plant(self, cell: "Workcell") -> DrivenPlant:
        """Build the simulation."""
        return make_twin(self.config, cell, engine=self.engine)


def local_address(
    plant: str, twin: Twin | str | Path | None
) -> PlantAddress | TwinAddress:
    """Return the address of a simulation here: of a twin where one is given."""
    if twin is None:
        return PlantAddress(text=plant, engine=plant)
    text = "" if isinstance(twin, Twin) else f"twin:{twin}"
    return TwinAddress(text=text, config=twin)
