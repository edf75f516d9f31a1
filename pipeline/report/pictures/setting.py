"""Pictures of the world and its demonstrations."""

from functools import partial

from pipeline.report.figures import (
    world,
)
from pipeline.report.pictures.picture import Drawn, Picture, picture
from pipeline.report.results import Results
from pipeline.report.wording import listed, percent


def calibrated_world(results: Results) -> Picture:
    cells = [c for by in results.world["p_valid"].values() for c in by.values() if c.get("paper") is not None]
    gap = max((abs(c["truth"] - c["paper"]) for c in cells), default=0.0)
    alt = (
        f"Dot plot of {len(cells)} cells: the simulated world's share of valid paths lies at most {gap:.3f} from "
        "the paper's number."
    )
    caption = (
        "The world beside the paper's Table 2: dots are the simulated truth, stars the paper, grey bars ± 0.03 "
        "around it."
    )
    return picture("world", caption, alt, partial(world.draw_calibration, results.world["p_valid"], results.users))


def demonstrations(results: Results, drawn: Drawn) -> Picture:
    shares = [f"{percent(valid.mean(), 0)} for {user}" for user, (_, valid) in drawn.demos.items()]
    alt = f"The same training scenes with each user's demonstrations; valid among those drawn: {listed(shares)}."
    caption = (
        f"Training scenes of seed {drawn.seed}, the most varied ones, with every demonstration of each user that the "
        f"models are given. Paths run from the circle to "
        f"the square; "
        "whole blue lines are valid to that user, broken orange ones are not."
    )
    return picture("demonstrations", caption, alt, partial(world.draw_demonstrations, drawn.scenes, drawn.demos))
