"""Make the materials of kitchenware as Blender's shader nodes: glazed ceramic, wood, metal, plastic and glass.

`Nodes` writes them as expressions: every method, and every operator between outputs, adds a node and returns its
output. Inputs are outputs, numbers or tuples. Colours are linear RGB. Lengths are in metres.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np

Rng = np.random.Generator
Socket = Any  # an `Output`, or a constant in its place


def _operator(operation: str, *, swapped: bool = False) -> Callable[["Output", Socket], Socket]:
    """Return the method of an operator that adds a node for it; swapped: the constant is on the left."""
    return lambda output, other: output.nodes.math(operation, *((other, output) if swapped else (output, other)))


@dataclass(frozen=True)
class Output:
    """An output of a node. A comparison is 1 where it holds and 0 elsewhere."""

    nodes: "Nodes"
    socket: Any

    __add__, __radd__ = _operator("ADD"), _operator("ADD", swapped=True)
    __sub__, __rsub__ = _operator("SUBTRACT"), _operator("SUBTRACT", swapped=True)
    __mul__, __truediv__, __pow__ = _operator("MULTIPLY"), _operator("DIVIDE"), _operator("POWER")
    __lt__, __gt__ = _operator("LESS_THAN"), _operator("GREATER_THAN")

    def __abs__(self) -> Socket:
        return self.nodes.math("ABSOLUTE", self)


class Nodes:
    """The nodes of a material under construction, or of a world's."""

    def __init__(self, owner: Any) -> None:
        self.owner, owner.use_nodes = owner, True
        self.tree = owner.node_tree
        self.tree.nodes.clear()

    def add(self, kind: str, inputs: dict[Any, Any] | None = None, out: int = 0, **settings: Any) -> Socket:
        """Add a node `kind` with these inputs and settings; return its output number `out`."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        for name, value in (inputs or {}).items():
            socket = node.inputs[name]
            if isinstance(value, Output):
                self.tree.links.new(value.socket, socket)
            elif socket.type == "RGBA":
                socket.default_value = (*value, 1.0)
            else:
                socket.default_value = value
        return Output(self, node.outputs[out]) if node.outputs else None

    def math(self, operation: str, *values: Socket) -> Socket:
        """Return a scalar operation (SINE, MAXIMUM, ...) of the values."""
        return self.add("Math", dict(enumerate(values)), operation=operation)

    def place(self, rng: Rng, stretch: tuple[float, float] = (1.0, 1.0), turn: float | None = None) -> Socket:
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
        return self.add("TexNoise", {"Vector": where, "Scale": scale, "Detail": detail, "Distortion": warp})

    def cells(self, where: Socket, scale: float, out: int = 1, **settings: Any) -> Socket:
        """Return Voronoi cells: 0 the distance from their centres [cells], 1 a random colour each."""
        return self.add("TexVoronoi", {"Vector": where, "Scale": scale}, out=out, **settings)

    def random(self, where: Socket, out: int = 0) -> Socket:
        """Return a random number (0) or colour (1) for each value of a vector."""
        return self.add("TexWhiteNoise", {"Vector": where}, out=out, noise_dimensions="3D")

    def step(self, value: Socket, low: float, high: float) -> Socket:
        """Return 0 below `low`, 1 above `high` and a smooth transition between."""
        inputs = {"Value": value, 1: low, 2: high, 3: 0.0, 4: 1.0}
        return self.add("MapRange", inputs, interpolation_type="SMOOTHSTEP")

    def mix(self, share: Socket, a: Socket, b: Socket) -> Socket:
        """Return the colour `a` where the share is 0 and `b` where it is 1."""
        return self.add("Mix", {0: share, 6: a, 7: b}, out=2, data_type="RGBA")

    def wave(self, value: Socket, period: Socket) -> Socket:
        """Return a triangle wave from 0 to 1 and back over each period [m]."""
        return abs(self.math("FRACT", value / period) * 2.0 - 1.0)

    def whole(self, value: Socket, period: float) -> Socket:
        """Return the number of the period in which a value lies."""
        return self.math("FLOOR", value / period)

    def bump(self, height: Socket, distance: float) -> Socket:
        """Return the normal of a surface raised by `height` times `distance` [m]."""
        return self.add("Bump", {"Height": height, "Distance": distance, "Strength": 1.0})

    def principled(self, colour: Socket, **inputs: Socket) -> Socket:
        """Return Blender's Principled surface; names of inputs as in Blender, spaces as underscores."""
        named = {name.replace("_", " "): value for name, value in inputs.items()}
        return self.add("BsdfPrincipled", {"Base Color": colour, **named})

    def finish(self, surface: Socket) -> Any:
        """Return the material with this surface."""
        self.add("OutputMaterial", {"Surface": surface})
        return self.owner


def colour(hue: float, saturation: float, value: float) -> tuple[float, float, float]:
    """Return the linear RGB of a hue (0..1), saturation and value as an artist gives them (sRGB)."""
    k = (np.array([5, 3, 1]) + 6 * hue) % 6
    rgb = value * (1 - saturation * np.clip(np.minimum(k, 4 - k), 0, 1))
    red, green, blue = (float(c) for c in rgb**2.2)
    return red, green, blue


def random_colour(rng: Rng, neutral: float = 0.35) -> tuple[float, float, float]:
    """Draw a colour: a white, grey or cream with probability `neutral`, any hue otherwise."""
    if rng.random() < neutral:
        return colour(rng.uniform(0.05, 0.14), rng.uniform(0.0, 0.18), rng.choice([0.93, 0.85, 0.5, 0.2]))
    return colour(rng.random(), rng.uniform(0.25, 0.85), rng.uniform(0.3, 0.92))


def ceramic(seed: int, decoration: str, name: str) -> Any:
    """Return a glazed ceramic: plain, with rings, speckles, two glazes that run into each other, sectors, crackles,
    rings of dots, a gilded rim, one side dipped into another glaze, squares around its rim, or marbled.
    """
    rng, n = np.random.default_rng(seed), Nodes(bpy.data.materials.new(name))
    gauge = n.add("Attribute", attribute_name="gauge", out=2)
    where = n.add("TexCoord", out=3)
    bearing = n.math("ARCTAN2", n.axis(where, 1), n.axis(where, 0))
    base, accent = random_colour(rng, 0.55), random_colour(rng, 0.15)
    painted = n.mix(gauge < -0.5, base, accent if rng.random() < 0.3 else base)
    if decoration == "ringed":
        for _ in range(rng.integers(1, 4)):
            ring = abs(gauge - rng.uniform(0.25, 0.97)) < rng.choice([0.012, 0.03, 0.07])
            painted = n.mix(ring, painted, accent)
    if decoration == "speckled":
        painted = n.mix(n.step(n.cells(where, rng.uniform(90, 260), out=0), 0.30, 0.22) * 0.8, painted, accent)
    if decoration == "two glazes":
        level = rng.uniform(0.6, 1.05)
        painted = n.mix(n.step(gauge + n.noise(where, 40) * 0.5, level - 0.06, level + 0.06), painted, accent)
    if decoration == "sectors":
        twist = gauge * rng.choice([0.0, 2.0, 4.0])
        lobes = n.step(n.math("SINE", bearing * float(rng.integers(3, 12)) + twist), 0.1, 0.25)
        painted = n.mix(lobes * (gauge > rng.uniform(0.0, 0.6)), painted, accent)
    if decoration == "crackled":
        seams = n.cells(where, rng.uniform(50, 110), out=0, feature="DISTANCE_TO_EDGE")
        painted = n.mix(n.step(seams, 0.06, 0.02) * rng.uniform(0.5, 0.9), painted, accent)
    if decoration == "dotted":
        for radius in np.linspace(rng.uniform(0.35, 0.6), 0.88, rng.integers(1, 4)):
            dots = float(rng.integers(8, 20))
            along = (n.math("FRACT", bearing * (dots / (2 * np.pi))) - 0.5) * (2 * np.pi * radius / dots)
            away = along**2.0 + (gauge - radius) ** 2.0
            painted = n.mix(away < rng.uniform(0.03, 0.07) ** 2, painted, accent)
    if decoration == "dipped":
        painted = n.mix(n.axis(where, 0) > rng.uniform(-0.03, 0.03) + n.noise(where, 15.0) * 0.01, painted, accent)
    if decoration == "chequered":
        turns, rows = (n.whole(v, p) for v, p in ((bearing, np.pi / rng.integers(6, 14)), (gauge, 0.17)))
        odd = n.math("FLOORED_MODULO", turns + rows, 2.0)
        painted = n.mix(odd * (gauge > rng.uniform(0.3, 0.7)), painted, accent)
    if decoration == "marbled":
        painted = n.mix(n.step(n.noise(where, rng.uniform(12, 30), 2.0, 3.0), 0.5, 0.54), painted, accent)
    inputs: dict[str, Any] = {}
    if decoration == "gilded":
        inputs["Metallic"] = gauge > rng.uniform(0.86, 0.95)
        painted = n.mix(inputs["Metallic"], painted, colour(rng.uniform(0.09, 0.13), 0.5, 0.9))
    painted = n.mix(n.noise(where, 25.0, detail=2.0) * rng.uniform(0.0, 0.2), painted, accent)
    inputs["Coat_Weight"] = float(rng.random() < 0.75)
    inputs |= {"Roughness": rng.uniform(0.25, 0.5), "Coat_Roughness": rng.uniform(0.02, 0.15)}
    return n.finish(n.principled(painted, **inputs, Normal=n.bump(n.noise(where, 60.0), 0.0003)))


def wood(seed: int, name: str) -> Any:
    """Return oiled wood with its grain along x."""
    rng, n = np.random.default_rng(seed), Nodes(bpy.data.materials.new(name))
    dark = colour(rng.uniform(0.05, 0.09), rng.uniform(0.4, 0.7), rng.uniform(0.25, 0.5))
    light = colour(rng.uniform(0.07, 0.1), rng.uniform(0.35, 0.6), rng.uniform(0.5, 0.8))
    stretched = n.add("Mapping", {"Vector": n.add("TexCoord", out=3), "Scale": (6.0, 90.0, 90.0)})
    grain = n.step(n.noise(stretched, 1.0, detail=4.0, warp=0.6), 0.3, 0.7)
    return n.finish(n.principled(n.mix(grain, dark, light), Roughness=rng.uniform(0.4, 0.65)))


def metal(seed: int, kind: str, name: str) -> Any:
    """Return polished, black or rainbow steel, a yellow or red metal (`brass`), or either for crockery (`enamel`)."""
    rng, n = np.random.default_rng(seed), Nodes(bpy.data.materials.new(name))
    steel = colour(0.6, 0.02, rng.uniform(0.72, 0.86))
    brass = colour(rng.uniform(0.04, 0.13), rng.uniform(0.3, 0.55), rng.uniform(0.75, 0.92))
    if kind == "black steel":
        steel, kind = colour(0.6, 0.05, rng.uniform(0.22, 0.4)), "steel"
    tint = steel if kind == "steel" or (kind == "enamel" and rng.random() < 0.6) else brass
    if kind == "rainbow steel":  # its hue runs along the piece
        hue = n.math("FRACT", rng.random() + n.axis(n.add("TexCoord", out=3), 0) * 6.0)
        tint = n.add("CombineColor", {0: hue, 1: rng.uniform(0.4, 0.7), 2: rng.uniform(0.5, 0.8)}, mode="HSV")
    rough = rng.uniform(0.12, 0.34) + n.noise(n.add("TexCoord", out=3), 300.0) * 0.1
    return n.finish(n.principled(tint, Metallic=1.0, Roughness=rough))


def plastic(seed: int, name: str) -> Any:
    """Return coloured plastic."""
    rng, n = np.random.default_rng(seed), Nodes(bpy.data.materials.new(name))
    return n.finish(n.principled(random_colour(rng, 0.25), Roughness=rng.uniform(0.2, 0.5)))


def two_colours(pattern: str, seed: int, name: str) -> Any:
    """Return plastic of two colours: striped across the length of a handle, or swirled."""
    rng, n = np.random.default_rng(seed), Nodes(bpy.data.materials.new(name))
    where = n.add("TexCoord", out=3)
    band = n.wave(n.axis(where, 0), rng.uniform(0.008, 0.03)) < 0.5
    if pattern == "swirled":
        band = n.step(n.noise(where, rng.uniform(40, 90), 2.0, 2.0), 0.45, 0.55)
    painted = n.mix(band, random_colour(rng, 0.3), random_colour(rng, 0.3))
    return n.finish(n.principled(painted, Roughness=rng.uniform(0.2, 0.5)))


def glass(seed: int, kind: str, name: str) -> Any:
    """Return refracting glass (index 1.45 to 1.52): clear, tinted, frosted, clear with a coloured rim, smoked, clear
    with ribs or bubbles, or graded from one tint below to another above.

    Rays that light other things pass straight through, dimmed at grazing angles, for a path tracer finds no caustics.
    """
    rng, n = np.random.default_rng(seed), Nodes(bpy.data.materials.new(name))
    hue = rng.random()
    tint = {
        "clear": colour(hue, rng.uniform(0.0, 0.02), rng.uniform(0.97, 1.0)),
        "pale tint": colour(hue, rng.uniform(0.02, 0.08), rng.uniform(0.96, 1.0)),
        "deep tint": colour(hue, rng.uniform(0.12, 0.4), rng.uniform(0.85, 0.98)),
        "frosted": colour(hue, rng.uniform(0.0, 0.06), rng.uniform(0.96, 1.0)),
        "coloured rim": colour(hue, 0.0, 0.99),
    }.get(kind)
    if tint is None:  # light passes four surfaces: smoked glass lets 0.25 to 0.6 of it through
        smoked = colour(hue, 0.04, rng.uniform(0.86, 0.94))
        tint = smoked if kind == "smoked" else colour(hue, 0.0, 0.99)
    if kind == "graded":
        low, high = (colour(hue + shift, rng.uniform(0.06, 0.2), 0.98) for shift in (0.0, 0.4))
        tint = n.mix(n.axis(n.add("TexCoord"), 2), low, high)
    rough = rng.uniform(0.15, 0.35) if kind == "frosted" else 0.0
    inputs = {"Color": tint, "Roughness": rough, "IOR": rng.uniform(1.45, 1.52)}
    if kind == "ribbed":
        where = n.add("TexCoord", out=3)
        bearing = n.math("ARCTAN2", n.axis(where, 1), n.axis(where, 0))
        ribs = n.math("SINE", bearing * float(rng.integers(12, 28)))
        inputs |= {"IOR": 1.5, "Normal": n.bump(ribs, rng.uniform(0.0004, 0.001))}
    if kind == "bubbled":
        bubbles = n.step(n.cells(n.add("TexCoord", out=3), rng.uniform(70, 130), out=0), 0.35, 0.1)
        inputs |= {"IOR": 1.5, "Normal": n.bump(bubbles, 0.001)}
    body = n.add("BsdfGlass", inputs)
    if kind == "coloured rim":
        rim = n.axis(n.add("TexCoord"), 2) > 0.96
        body = n.add("MixShader", {0: rim, 1: body, 2: n.principled(colour(hue, 0.7, 0.8), Roughness=0.2)})
    dimmed = n.mix(n.add("LayerWeight", {"Blend": 0.5}, out=1) ** 1.5, tint, (0.35, 0.35, 0.35))
    through = n.add("BsdfTransparent", {"Color": dimmed})
    lighting = n.math("MAXIMUM", n.add("LightPath", out=1), n.add("LightPath", out=2))
    return n.finish(n.add("MixShader", {0: lighting, 1: body, 2: through}))
