"""Parameters of scenes and demonstrations."""

from pydantic import model_validator

from pipeline.runtime.settings import (
    Chance,
    Count,
    Demonstrations,
    Distance,
    Group,
    Length,
    Pair,
    Place,
    Range,
    Several,
    ShareRange,
    Size,
    Some,
    Spread,
    Whole,
    need,
    need_some,
)
from pipeline.world.patterns import PATTERNS


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


class Source(Group):
    exposure: Range
    white_balance: Spread
    fall_off: ShareRange
    vignette: ShareRange
    noise: ShareRange
    shadow_length: Range
    shadow_softness: Range
    shadow_depth: Range
    refraction: ShareRange
    caustic: Range
    highlight: ShareRange
    glare: ShareRange
    pattern_chance: Chance
    patterns: Some
    fold_chance: Chance
    parallax: ShareRange
    tilt_px: Range

    @model_validator(mode="after")
    def _agrees(self) -> "Source":
        need_some("scenes.source.patterns", self.patterns, PATTERNS)
        return self


class Scenes(Group):
    root_seed: Whole
    per_seed: Count
    shared: Several
    validation: Count
    calibration: Count
    calibration_paths: Count
    prior_side: Count
    layout: Layout
    source: Source


class Hand(Group):
    rate_hz: Size
    jitter_s: Spread
    speed_m_s: Size
    speed_spread: Spread
    tremor_m: Distance
    tremor_hz: Pair
    drift_m: Distance
    height_m: float
    height_drift_m: Distance

    @model_validator(mode="after")
    def _agrees(self) -> "Hand":
        low, high = self.tremor_hz
        band = "a band above 0, the lower end first, below half of rate_hz"
        need(0 < low <= high < self.rate_hz / 2, "demos.hand.tremor_hz", self.tremor_hz, band)
        return self


class Demos(Group):
    root_seed: Whole
    per_scene: Demonstrations
    queries_seen: Count
    queries_new: Count
    recorded: str | None
    ends_within_m: Length
    poor_above_m: Length
    hand: Hand
