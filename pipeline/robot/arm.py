"""Load an arm that a package ships: kinematics and collision shapes, with the rest of the robot held still."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Float
from numpy import ndarray as Array
from xacrodoc import XacroDoc, packages  # pyright: ignore[reportMissingImports]

TURN = 2 * np.pi  # a joint without stops may turn once either way from zero [rad]
GRIP = "grip"  # frame between the fingers; its z axis points up while the arm carries


@dataclass(frozen=True)
class Arm:
    """A serial arm in the frame of its robot's base: x ahead, y to the left, z up; [m] and [rad].

    model, shapes: pinocchio's kinematics and collision shapes, the arm's joints alone; posture: the joint positions
    that inverse kinematics prefers where the task leaves a choice.
    """

    name: str
    model: pin.Model
    shapes: pin.GeometryModel
    posture: Float[Array, " joint"]

    @property
    def joints(self) -> list[str]:
        """Return the names of the joints."""
        return list(self.model.names[1:])


def load_arm(name: str, settings: Mapping[str, Any]) -> Arm:
    """Return the arm of `settings` (studies.execution.arms) from the robot descriptions in the package rtb-data."""
    root = Path(str(files("rtbdata"))) / "xacro"
    packages.update_package_cache({folder.name: str(folder) for folder in root.iterdir() if folder.is_dir()})
    text = with_angles(XacroDoc.from_file(str(root / settings["file"])).to_urdf_string())
    model = pin.buildModelFromXML(text)
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(text)
        file.flush()
        shapes = pin.buildGeomFromUrdf(model, file.name, pin.GeometryType.COLLISION)
    q = pin.neutral(model)
    for joint, position in settings["still"].items():
        q[model.joints[model.getJointId(joint)].idx_q] = position
    still = [i for i in range(1, model.njoints) if model.names[i] not in settings["posture"]]
    model, shapes = pin.buildReducedModel(model, shapes, still, q)
    tool = model.frames[model.getFrameId(settings["tool"])]
    turn = pin.utils.rotate("y", -np.deg2rad(settings["pitch_deg"]))
    placement = tool.placement * pin.SE3(np.eye(3), np.array(settings["offset_m"], float)) * pin.SE3(turn, np.zeros(3))
    model.addFrame(pin.Frame(GRIP, tool.parentJoint, 0, placement, pin.FrameType.OP_FRAME))
    return Arm(name, model, shapes, np.array([settings["posture"][joint] for joint in model.names[1:]], float))


def with_angles(urdf: str) -> str:
    """Return the description with joints without stops limited to a turn, so that each position is one angle."""
    tree = ElementTree.fromstring(urdf)
    for joint in tree.iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit", effort="0", velocity="0") if limit is None else limit
            limit.attrib.update({"lower": str(-TURN), "upper": str(TURN)})
    return ElementTree.tostring(tree, encoding="unicode")
