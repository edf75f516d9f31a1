"""Write Blender's shader nodes as expressions: every method adds a node and returns its output.

Inputs are sockets, numbers or tuples. Colours are linear RGB. Lengths are in metres.
"""

from typing import Any

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np

Socket = Any  # an output of a node, or a constant in its place


class Nodes:
    """A material under construction."""

    def __init__(self, name: str) -> None:
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()

    def add(self, kind: str, inputs: dict[int | str, Any] | None = None, out: int = 0, **settings: Any) -> Socket:
        """Add a node `kind` with these inputs and settings; return its output number `out`."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        for name, value in (inputs or {}).items():
            socket = node.inputs[name]
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            elif socket.type == "RGBA":
                socket.default_value = (*value, 1.0)
            else:
                socket.default_value = value
        return node.outputs[out] if node.outputs else None

    def math(self, operation: str, *values: Socket) -> Socket:
        """Return a scalar operation (ADD, MULTIPLY, SINE, ...) of the values."""
        return self.add("Math", dict(enumerate(values)), operation=operation)

    def place(
        self, rng: np.random.Generator, stretch: tuple[float, float] = (1.0, 1.0), turn: float | None = None
    ) -> Socket:
        """Return the position on the table [m], shifted and turned at random and stretched along both axes."""
        turn = rng.uniform(-np.pi, np.pi) if turn is None else turn
        shift = (*rng.uniform(-50, 50, 2), rng.uniform(-50, 50))
        position = self.add("NewGeometry")
        turned = self.add("Mapping", {"Vector": position, "Rotation": (0.0, 0.0, turn)}, vector_type="POINT")
        return self.add("Mapping", {"Vector": turned, "Location": shift, "Scale": (*stretch, 1.0)}, vector_type="POINT")

    def axis(self, vector: Socket, index: int) -> Socket:
        """Return one coordinate of a vector."""
        return self.add("SeparateXYZ", {0: vector}, out=index)

    def vector(self, x: Socket, y: Socket, z: Socket = 0.0) -> Socket:
        """Return the vector of three coordinates."""
        return self.add("CombineXYZ", {0: x, 1: y, 2: z})

    def noise(self, where: Socket, scale: float, detail: float = 3.0, warp: float = 0.0) -> Socket:
        """Return Perlin noise, in about 0.2 to 0.8, with `scale` features a metre."""
        inputs: dict[int | str, Any] = {"Vector": where, "Scale": scale, "Detail": detail, "Distortion": warp}
        return self.add("TexNoise", inputs)

    def cells(self, where: Socket, scale: float, out: int = 1, **settings: Any) -> Socket:
        """Return Voronoi cells: 0 the distance from their centres [cells], 1 a random colour each."""
        return self.add("TexVoronoi", {"Vector": where, "Scale": scale}, out=out, **settings)

    def random(self, where: Socket, out: int = 0) -> Socket:
        """Return a random number (0) or colour (1) for each value of a vector."""
        return self.add("TexWhiteNoise", {"Vector": where}, out=out, noise_dimensions="3D")

    def step(self, value: Socket, low: float, high: float) -> Socket:
        """Return 0 below `low`, 1 above `high` and a smooth transition between."""
        inputs: dict[int | str, Any] = {"Value": value, 1: low, 2: high, 3: 0.0, 4: 1.0}
        return self.add("MapRange", inputs, interpolation_type="SMOOTHSTEP")

    def mix(self, share: Socket, a: Socket, b: Socket) -> Socket:
        """Return the colour `a` where the share is 0 and `b` where it is 1."""
        return self.add("Mix", {0: share, 6: a, 7: b}, out=2, data_type="RGBA")

    def wave(self, value: Socket, period: Socket) -> Socket:
        """Return a triangle wave from 0 to 1 and back over each period [m]."""
        turn = self.math("FRACT", self.math("DIVIDE", value, period))
        return self.math("ABSOLUTE", self.math("SUBTRACT", self.math("MULTIPLY", turn, 2.0), 1.0))

    def whole(self, value: Socket, period: float) -> Socket:
        """Return the number of the period in which a value lies."""
        return self.math("FLOOR", self.math("DIVIDE", value, period))

    def bump(self, height: Socket, distance: float) -> Socket:
        """Return the normal of a surface raised by `height` times `distance` [m]."""
        return self.add("Bump", {"Height": height, "Distance": distance, "Strength": 1.0})

    def principled(self, colour: Socket, **inputs: Socket) -> Socket:
        """Return Blender's Principled surface; names of inputs as in Blender, spaces as underscores."""
        named: dict[int | str, Any] = {name.replace("_", " "): value for name, value in inputs.items()}
        return self.add("BsdfPrincipled", {"Base Color": colour, **named})

    def finish(self, surface: Socket) -> Any:
        """Return the material with this surface."""
        self.add("OutputMaterial", {"Surface": surface})
        return self.material
