"""Any curve: the paper's paths as points are the same paths, and where a polyline's own points lie does not matter."""

import numpy as np
import pytest
import torch

from pipeline import library
from pipeline.models.clearance.clearance import passes
from pipeline.models.curves import resample
from pipeline.models.trained import build
from pipeline.planning.bumps import displacement
from pipeline.runtime.errors import InputError
from pipeline.world.bezier import bezier, curve, random_z_theta
from pipeline.world.layout import random_layouts
from pipeline.world.rules import clearance, line_clearance
from tests.factories import ITEMS, RULES, as_controls, percept

RNG = np.random.default_rng(0)
LAYOUTS = random_layouts(RNG, 4, ITEMS, np.arange(4), RULES)
Z = random_z_theta(RNG, 4, 30)
POINTS = bezier(as_controls(Z), 200)
IMAGES = RNG.integers(0, 255, (4, 100, 100, 3), np.uint8)


def test_the_papers_paths_are_bezier_curves_of_degree_2():
    np.testing.assert_allclose(bezier(as_controls(Z), 33), curve(Z, 33), atol=1e-12)


@pytest.mark.parametrize("count", [2, 17, 161])
def test_lines_with_stops_and_even_steps_are_divided_as_interpolation_along_the_length_says(count: int):
    lines = np.repeat(np.round(np.random.default_rng(1).uniform(0, 1, (6, 40, 2)), 1), 3, axis=1)
    lines[0] = np.linspace(0, 1, 120)[:, None]  # aims meet its points
    divided = resample(torch.from_numpy(lines)[None], count)[0].numpy()
    for line, points in zip(lines, divided, strict=True):
        passed = np.r_[0, np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum()]
        aims = np.linspace(0, passed[-1], count)
        expected = np.stack([np.interp(aims, passed, line[:, axis]) for axis in (0, 1)], -1)
        np.testing.assert_allclose(points, expected, atol=1e-9)


def test_clearances_of_a_curve_are_those_of_the_geometry_and_of_z_theta():
    seen, points = percept(LAYOUTS).float(), torch.from_numpy(POINTS).float()
    of_curve, of_z = passes(seen, points), passes(seen, torch.from_numpy(Z).float())
    near, there = of_z.relations.shape[2], LAYOUTS.present[:, None] & (line_clearance(LAYOUTS, POINTS) > 0.02)
    truth = np.where(there, line_clearance(LAYOUTS, POINTS), 0)[..., :near]
    found = np.where(there[..., :near], of_curve.clearance[..., 0].numpy(), 0)
    np.testing.assert_allclose(found, truth, atol=1e-3)
    np.testing.assert_allclose(truth, np.where(there, clearance(LAYOUTS, Z), 0)[..., :near], atol=1e-3)
    side = (of_curve.relations[..., 0] - of_z.relations[..., 0]).abs()[of_z.clearance[..., 0].abs() > 0.01]
    assert side.quantile(0.95) < 0.05  # the nearest point is one of 161


@pytest.mark.parametrize("variant", ["clearance", "irl_ranked", "full"])
def test_every_model_reads_a_curve_whatever_points_it_is_given_by(variant: str):
    settings = library.SETTINGS[variant]
    if variant == "full":
        settings = settings | {"model": settings["model"] | {"path_numbers": 10}}
    model = build(settings, 0)
    fine = bezier(as_controls(Z), 800)
    p, from_fine = model.probability(IMAGES, POINTS), model.probability(IMAGES, fine)
    np.testing.assert_allclose(p, from_fine, atol=2e-3)


def test_a_model_of_z_theta_refuses_curves():
    with pytest.raises(InputError, match="fitted to z_theta"):
        build(library.SETTINGS["full"]).probability(IMAGES, POINTS)


def test_a_displacement_is_the_mean_distance_of_the_points():
    offsets = np.zeros((4, 2))
    assert displacement(offsets) == 0
    offsets[:, 0] = 0.6  # of the four inner ones of six polynomials, whose means along the curve are 1/6 each
    np.testing.assert_allclose(displacement(offsets), 0.4, atol=3e-3)
