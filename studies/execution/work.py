"""One arm in its place, with all that its executions share."""

from dataclasses import dataclass
from typing import Any

from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.robot.arm import Arm
from pipeline.robot.bench import Bench
from pipeline.robot.carried import Part, gripper_of
from pipeline.robot.execution import Motion, Tolerances, execute
from pipeline.robot.inverse import PostureMap
from pipeline.robot.physics import Solid
from studies.execution.placement import arm_of


@dataclass(frozen=True)
class Work:
    """An arm by its settings, table and base, its map of postures, and the mean speed of its grip."""

    name: str
    settings: str
    bench: Bench
    postures: PostureMap
    study: Any
    speed_m_s: float

    @property
    def arm(self) -> Arm:
        """Return the arm, loaded once in each process."""
        return arm_of(self.name, self.settings)

    def run(self, z_theta: Float[Array, "path 2"]) -> Motion:
        """Carry out paths."""
        study = self.study
        allowed = Tolerances(study.error_m, study.tilt_rad)
        return execute(self.arm, self.bench, self.postures, z_theta, study.instants, self.speed_m_s, allowed)

    def parts(self) -> tuple[Part, Part]:
        """Return the shaker and the gripper."""
        shaker = self.study.shaker
        return Part(0.0, 0.0, shaker.radius_m, shaker.below_m, shaker.above_m), gripper_of(self.arm)

    def solids(self) -> dict[str, Solid]:
        """Return height and mass of the items of each symbol at full size."""
        return {str(name): Solid(solid.height_m, solid.mass_kg) for name, solid in self.study.solids.items()}

    def heights(self) -> dict[str, float]:
        """Return the height [m] of the items of each symbol at full size."""
        return {name: solid.height_m for name, solid in self.solids().items()}
