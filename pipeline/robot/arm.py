"""The PR2's right arm, the table of the scenes before it at a size that it can cover, and what may collide."""

import tempfile
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Float
from numpy import ndarray as Array
from xacrodoc import XacroDoc, packages  # pyright: ignore[reportMissingImports]

DESCRIPTION = "pr2_description/robots/pr2_no_kinect.urdf.xacro"  # in the package rtb-data
GRIP = "r_gripper_tool_frame"  # frame between the fingers; its x axis points along them, its z axis up
TURN = 2 * np.pi  # a joint without stops may turn once either way from zero [rad]
THICK_M = 0.03  # thickness of the table's top


@dataclass(frozen=True)
class Arm:
    """A serial arm in the frame of its robot's base: x ahead, y to the left, z up; [m] and [rad].

    model, shapes: pinocchio's kinematics and collision shapes, the arm's joints alone; posture: the joint positions
    that inverse kinematics prefers where the task leaves a choice.
    """

    model: pin.Model
    shapes: pin.GeometryModel
    posture: Float[Array, " joint"]


@lru_cache(maxsize=1)
def load_arm(posture: tuple[tuple[str, float], ...], still: tuple[tuple[str, float], ...]) -> Arm:
    """Return the arm with the joints of `posture`, the preferred one [rad]; others are held at `still`, or at zero."""
    root = Path(str(files("rtbdata"))) / "xacro"
    packages.update_package_cache({folder.name: str(folder) for folder in root.iterdir() if folder.is_dir()})
    tree = ElementTree.fromstring(XacroDoc.from_file(str(root / DESCRIPTION)).to_urdf_string())
    for joint in tree.iterfind("joint[@type='continuous']"):  # stops, so that each position is one angle
        joint.set("type", "revolute")
        limit = joint.find("limit")
        limit = ElementTree.SubElement(joint, "limit", effort="0", velocity="0") if limit is None else limit
        limit.attrib.update({"lower": str(-TURN), "upper": str(TURN)})
    text = ElementTree.tostring(tree, encoding="unicode")
    model = pin.buildModelFromXML(text)
    with tempfile.NamedTemporaryFile("w", suffix=".urdf", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        shapes = pin.buildGeomFromUrdf(model, file.name, pin.GeometryType.COLLISION)
    q = pin.neutral(model)
    for name, position in still:
        q[model.joints[model.getJointId(name)].idx_q] = position
    held = [i for i in range(1, model.njoints) if model.names[i] not in dict(posture)]
    model, shapes = pin.buildReducedModel(model, shapes, held, q)
    return Arm(model, shapes, np.array([dict(posture)[joint] for joint in model.names[1:]], float))


@dataclass(frozen=True)
class Bench:
    """A table and the robot's base at its near edge, looking across it, in metres.

    All lengths of a scene, items' heights included, are multiplied by `side_m`; the arm and what it carries are not.
    """

    side_m: float  # side of the table; a scene's lengths are those of a table of 1 m
    base_x: float  # of the robot's base [m]: x to the right along the near edge, from its left end
    base_y: float  # y away from the robot; negative: before the near edge
    height_m: float  # of the table's top above the floor on which the base stands
    grip_m: float  # of the grip above the table's top

    @property
    def base(self) -> pin.SE3:
        """Return the pose of the base in the frame of the table, on the floor below its near left corner."""
        return pin.SE3(pin.utils.rotate("z", np.pi / 2), np.array([self.base_x, self.base_y, 0.0]))

    def to_base(self, points: Float[Array, "*point 2"]) -> Float[Array, "*point 3"]:
        """Return points of a scene [table sides] at the grip's height in the base's frame [m]."""
        flat = self.side_m * np.asarray(points, float)
        height = np.full((*flat.shape[:-1], 1), self.height_m + self.grip_m)
        return (np.concatenate([flat, height], -1) - self.base.translation) @ self.base.rotation

    def to_table(self, points: Float[Array, "*point 3"]) -> Float[Array, "*point 3"]:
        """Return points in the base's frame [m] in the frame of the table [m], with z above its top."""
        return points @ self.base.rotation.T + self.base.translation - [0.0, 0.0, self.height_m]


class Collisions:
    """Pairs of shapes that may meet: of the arm, of the rest of the robot, and the table.

    Shapes of neighbouring joints always touch and are left out, and so are those that touch in the preferred posture.
    """

    def __init__(self, arm: Arm, bench: Bench, obstacle_m: float):
        self.arm, shapes = arm, arm.shapes.copy()
        box = coal.Box(bench.side_m, bench.side_m, THICK_M + obstacle_m)
        middle = np.array([bench.side_m / 2, bench.side_m / 2, bench.height_m + (obstacle_m - THICK_M) / 2])
        pose = bench.base.inverse() * pin.SE3(np.eye(3), middle)
        table = shapes.addGeometryObject(pin.GeometryObject("table", 0, pose, box))
        joints = [shape.parentJoint for shape in shapes.geometryObjects]
        for first, second in combinations(range(table), 2):
            if abs(joints[first] - joints[second]) > 1:
                shapes.addCollisionPair(pin.CollisionPair(first, second))
        self.shapes, self.data, geometry = shapes, arm.model.createData(), pin.GeometryData(shapes)
        pin.computeCollisions(arm.model, self.data, shapes, geometry, arm.posture, False)
        for pair, result in zip(list(shapes.collisionPairs), geometry.collisionResults, strict=True):
            if result.isCollision():
                shapes.removeCollisionPair(pair)
        for shape in range(table):  # the robot's body, too: it must not stand in the table
            shapes.addCollisionPair(pin.CollisionPair(shape, table))
        self.geometry = pin.GeometryData(shapes)

    def at(self, q: Float[Array, " joint"]) -> bool:
        """Return whether any pair touches at joint positions [rad]."""
        return bool(pin.computeCollisions(self.arm.model, self.data, self.shapes, self.geometry, q, True))
