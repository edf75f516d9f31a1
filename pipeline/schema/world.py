"""Scenes, and demonstrations in them."""

from pydantic import model_validator

from pipeline.schema.values import (
    Chance,
    Count,
    Demonstrations,
    Distance,
    Group,
    Length,
    Pair,
    Place,
    Size,
    Whole,
    need,
)


class Layout(Group):
    items_per_scene: list[Whole]
    glasses_chance: list[Chance]
    centre_low: Place
    centre_high: Place
    clear_of_ends: Distance
    clear_of_items: Distance
    scale_low: Size
    scale_high: Size
    slots: Count

    @model_validator(mode="after")
    def _agrees(self) -> "Layout":
        def of_layout(holds: bool, name: str, what: str) -> None:
            need(holds, f"scenes.layout.{name}", getattr(self, name), what)

        counts, room = self.items_per_scene, self.slots - 1
        one_less = f"whole numbers from 0 to {room}, one less than scenes.layout.slots"
        of_layout(bool(counts) and max(counts) <= room, "items_per_scene", one_less)
        of_layout(abs(sum(self.glasses_chance) - 1) < 1e-9, "glasses_chance", "chances from 0 that add up to 1")
        of_layout(self.centre_low <= self.centre_high, "centre_high", "a place from centre_low to 1 [m]")
        of_layout(self.scale_low <= self.scale_high, "scale_high", "a size from scale_low")
        return self


class Scenes(Group):
    generator: Whole
    per_seed: Count
    shared: Count
    validation: Count
    calibration: Count
    calibration_paths: Count
    prior_side: Count
    layout: Layout


class Hand(Group):
    rate_hz: float
    jitter_s: float
    speed_m_s: float
    speed_spread: float
    tremor_m: float
    tremor_hz: Pair
    drift_m: float
    height_m: float
    height_drift_m: float


class Demos(Group):
    generator: Whole
    per_scene: Demonstrations
    queries_seen: Count
    queries_new: Count
    recorded: str | None
    ends_within_m: Length
    poor_above_m: Length
    hand: Hand
