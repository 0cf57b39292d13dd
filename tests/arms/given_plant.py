"""Address of an arm over a plant that is there already."""

from dataclasses import dataclass

from dovetail.arms.local_address import PlantAddress
from dovetail.plants.plant import Plant


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenPlant(PlantAddress):
    """Its arm is built once: closing the arm closes the plant."""

    engine: str = "given"
    plant: Plant

    def make_plant(self, cell):
        return self.plant
