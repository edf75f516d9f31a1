"""Set up Blender's scene: table, lamps, surroundings, camera; and take pictures of it with Cycles.

Blender's x and y are the table's [m]; z points up to the camera. Row 0 of a picture is the far edge.
"""

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np

from making.render.finishes import Nodes
from making.render.kitchenware import Design
from making.render.tops import table_top
from pipeline.world.layout import SIDE

SAMPLES = 12  # paths a pixel, before the denoiser
GROUND_M = 3.0  # side of the table top, which reaches beyond the picture [m]
SHARP_RAD = 0.6  # edges of a wider angle are sharp; a smooth base would bend light like a lens [rad]
LAMPS = ("window", "lamp", "two lamps", "sun", "low sun", "overcast")
IRRADIANCE = np.pi  # of the table's centre by all light together: a white table then has radiance 1
ADAPTATION = 0.55  # share of the table's brightness that the camera's automatic exposure takes away
MIDDLE_GREY = 0.22  # linear level to which it exposes
SHOULDER = 0.6  # linear level above which highlights are compressed


class Light(NamedTuple):
    """Name what lights a scene, and where the camera hangs."""

    lamps: str  # one of LAMPS
    elevation_deg: float  # of the strongest lamp; 90: overhead
    camera_m: float  # height of the camera's lens; inf: orthographic


def set_up() -> None:
    """Empty Blender's scene and set Cycles up: one thread, few samples, denoiser, data kept between pictures."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    scene.render.resolution_percentage = 100
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.use_persistent_data = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    cycles = scene.cycles
    cycles.device, cycles.samples = "CPU", SAMPLES
    cycles.use_adaptive_sampling = False
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "FAST"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 10, 3, 3
    cycles.transmission_bounces, cycles.transparent_max_bounces = 8, 8
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = 4.0


def furnish(rng: np.random.Generator, family: str) -> Light:
    """Replace whatever stands in the scene by a bare table of this family under random light; return the light."""
    data = bpy.data
    for collection in (data.objects, data.meshes, data.materials, data.lights, data.cameras, data.worlds, data.images):
        for block in list(collection):
            collection.remove(block)
    bpy.ops.mesh.primitive_plane_add(size=GROUND_M, location=(0.5, 0.5, 0.0))
    bpy.context.object.data.materials.append(table_top(rng, family))
    lamps = str(rng.choice(LAMPS))
    surroundings = 0.9 if lamps == "overcast" else rng.uniform(0.12, 0.5)  # share of the irradiance
    _surround(rng, surroundings)
    elevation = rng.uniform(*{"sun": (40, 75), "low sun": (14, 35), "window": (15, 45)}.get(lamps, (30, 85)))
    shares = [0.65, 0.35] if lamps == "two lamps" else [1.0]
    for i, share in enumerate(shares):
        above = elevation if i == 0 else rng.uniform(25, 80)
        _lamp(rng, lamps, np.radians(above), share * (1 - surroundings) * IRRADIANCE)
    camera_m = np.inf if rng.random() < 0.5 else rng.uniform(8.0, 14.0)
    _camera(camera_m)
    bpy.context.scene.cycles.seed = int(rng.integers(2**31))
    return Light(lamps, float(elevation), float(camera_m))


def _surround(rng: np.random.Generator, share: float) -> None:
    """Surround the table by a room of two colours, brighter on one side, that gives this share of the irradiance."""
    world = bpy.context.scene.world = bpy.data.worlds.new("room")
    n = Nodes(world)
    inputs = {"Vector": n.add("TexCoord"), "W": rng.uniform(-50, 50), "Scale": rng.uniform(0.8, 2.5)}
    ramp = n.add("ValToRGB", {0: n.add("TexNoise", inputs, noise_dimensions="4D")})
    tint = 1 + rng.normal(0, 0.08, 3)
    low, high = rng.uniform(0.1, 0.6), rng.uniform(1.4, 3.0)
    stops = zip(ramp.socket.node.color_ramp.elements, (0.35, 0.7), (low * tint, high * tint[::-1]), strict=True)
    for stop, position, colour in stops:
        stop.position, stop.color = position, (*colour, 1.0)
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 64
    n.add("OutputWorld", {"Surface": n.add("Background", {"Color": ramp, "Strength": share})})


def _lamp(rng: np.random.Generator, lamps: str, elevation: float, irradiance: float) -> None:
    """Add a lamp at this elevation [rad] that gives the table's centre this irradiance."""
    bearing = rng.uniform(-np.pi, np.pi)
    x, y = np.cos(bearing) * np.cos(elevation), np.sin(bearing) * np.cos(elevation)
    towards = np.array([x, y, np.sin(elevation)])  # from the table's centre
    is_sun = lamps in ("sun", "low sun")
    light = bpy.data.lights.new("lamp", "SUN" if is_sun else "AREA")
    warmth = rng.uniform(-0.12, 0.16)
    light.color = (1 + warmth, 1.0, 1 - warmth)
    distance = rng.uniform(1.0, 2.5)
    if is_sun:
        light.angle = np.radians(rng.uniform(0.5, 5.0))
        light.energy = irradiance / np.sin(elevation)
    else:
        light.shape = str(rng.choice(["DISK", "RECTANGLE"]))
        if lamps == "window":
            light.size, light.size_y, distance = rng.uniform(0.6, 1.6), rng.uniform(0.6, 1.6), rng.uniform(1.6, 3.0)
        else:
            light.size = light.size_y = rng.uniform(0.08, 0.5)
        light.energy = irradiance * np.pi * distance**2 / np.sin(elevation)
    lamp = bpy.data.objects.new("lamp", light)
    lamp.location = np.array([0.5, 0.5, 0.0]) + distance * towards
    lamp.rotation_euler = (np.pi / 2 - elevation, 0.0, bearing + np.pi / 2)
    bpy.context.collection.objects.link(lamp)


def _camera(height_m: float) -> None:
    """Hang the camera straight above the table's centre; its picture is exactly the 1 m table."""
    camera = bpy.data.cameras.new("camera")
    if np.isinf(height_m):
        camera.type, camera.ortho_scale = "ORTHO", 1.0
    else:
        camera.sensor_width = 36.0
        camera.lens = 36.0 * height_m  # [mm]: 1 m at this height fills the sensor
    camera.clip_end = 100.0
    hung = bpy.data.objects.new("camera", camera)
    hung.location = (0.5, 0.5, 5.0 if np.isinf(height_m) else height_m)
    bpy.context.collection.objects.link(hung)
    bpy.context.scene.camera = hung


def stand(design: Design, centre: np.ndarray, angle: float, scale: float) -> list[Any]:
    """Put an item onto the table at this place [m], angle [rad] and scale; return its objects."""
    objects = []
    for i, part in enumerate(design.parts):
        mesh = bpy.data.meshes.new(f"{design.symbol} {i}")
        mesh.from_pydata(part.mesh.vertices.tolist(), [], part.mesh.faces.tolist())
        mesh.attributes.new("gauge", "FLOAT", "POINT").data.foreach_set("value", part.mesh.gauge.astype(np.float32))
        mesh.shade_smooth()
        mesh.set_sharp_from_angle(angle=SHARP_RAD)
        mesh.materials.append(part.paint(f"{design.symbol} {i}"))
        body = bpy.data.objects.new(f"{design.symbol} {i}", mesh)
        body.location, body.scale = (*centre, 0.0003), (scale,) * 3
        body.rotation_euler = (0.0, 0.0, angle)
        bpy.context.collection.objects.link(body)
        objects.append(body)
    return objects


def radiance(shown: list[Any], hidden: list[Any]) -> np.ndarray:
    """Return the picture (100, 100, 3) in linear RGB with these objects shown and those hidden."""
    for body in shown + hidden:
        body.hide_render = body in hidden
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.exr"
        bpy.context.scene.render.filepath = str(file)
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(str(file))
        pixels = np.empty(SIDE * SIDE * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    return pixels.reshape(SIDE, SIDE, 4)[::-1, :, :3].astype(float)


class Camera(NamedTuple):
    """Hold how the camera turns light into numbers."""

    exposure: float
    white_balance: np.ndarray  # gain of each channel
    noise: float  # standard deviation at white [1 = white]

    def photograph(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return the uint8 picture of linear RGB: exposure, white balance, sensor noise, highlights, sRGB."""
        level = np.maximum(light * self.exposure * self.white_balance, 0)
        level = level + rng.standard_normal(level.shape) * self.noise * np.sqrt(0.02 + level)
        beyond = (level - SHOULDER) / (1 - SHOULDER)
        level = np.where(level < SHOULDER, level, SHOULDER + (1 - SHOULDER) * (1 - np.exp(-np.maximum(beyond, 0))))
        level = np.clip(level, 0, 1)
        srgb = np.where(level < 0.0031308, 12.92 * level, 1.055 * level ** (1 / 2.4) - 0.055)
        return np.rint(255 * srgb).astype(np.uint8)


def exposed(rng: np.random.Generator, empty: np.ndarray) -> Camera:
    """Draw a camera that is exposed for this empty table, as far as ADAPTATION goes."""
    middle = float(np.median(empty.mean(-1)))
    exposure = (MIDDLE_GREY / max(middle, 1e-4)) ** ADAPTATION * rng.uniform(0.75, 1.3)
    return Camera(exposure, 1 + rng.normal(0, 0.04, 3), rng.uniform(0.003, 0.02))
