"""Settings of studies that make no sense are refused by name, before any work."""

import pytest
from omegaconf import OmegaConf

from pipeline.params import compose, validate
from pipeline.world.layout import SYMBOLS

REFUSED = {  # study: (name below studies.STUDY, value, what the error says besides the name)
    "acceptance": [
        ("variants", ["unknown"], ""),
        ("variants", [], ""),
        ("level", 0.03, " = 0.03 among them"),
        ("level", 1.0, ""),
        ("levels", [0.2, 0.1], ".*ascending numbers"),
        ("fitted", 20, ""),
    ],
    "confounding": [
        ("worlds.always", 1.5, ""),
        ("worlds.control", 0.5, ""),
        ("gap_m", [0.001, 0.04], ""),
        ("worlds", {}, ""),
        ("glasses", 3, ""),
        ("near_m", 0, ""),
        ("users", ["carefull"], ""),
        ("variants", {"fulll": ["confounded"]}, ""),
        ("variants.clearance", ["control"], ""),
        ("examples", 0, ""),
    ],
    "counterfactuals": [
        ("scenes", 1, ""),
        ("scenes", 1000, ".*at most scenes.shared"),
        ("moved_scenes", 7, ".*at most studies.counterfactuals.scenes"),
        ("move_step", 0.0, ""),
        ("example_variant", "best", ""),
        ("split", "seen_scenes", ".*new_scenes, new_items"),
    ],
    "envelope": [
        ("doses", 1, ""),
        ("paths", 0.5, ""),
        ("candidates", 0, ""),
        ("step", 0.0, ""),
        ("clear_of_others", 0.04, ".*more than the widest margin in users"),
        ("planner", "unknown", ""),
    ],
    "identification": [
        ("paths", 0, ""),
        ("draws", True, ""),
        ("reported", [1, 1000], ".*whole numbers from 1 to studies.identification.paths"),
        ("level", 1.0, ""),
        ("stranger", dict.fromkeys(SYMBOLS), ".*margins that no user has"),
        ("stranger", dict.fromkeys(SYMBOLS, -1.0), ".bowl"),
        ("split", "seen_scenes", ".*new_scenes, new_items"),
    ],
    "refutation": [
        ("scenes", 3, ""),
        ("scenes", 4.5, ""),
        ("far_m", 0.04, ""),
        ("dummy_outcome", ["unknown"], ""),
        ("pieces", [3], ""),
    ],
    "robustness": [
        ("split", "seen_scenes", ""),
        ("scenes", 1, ""),
        ("scenes", 10_000, ""),
        ("corruptions", {"fog": [0.1]}, ".*fog"),
        ("corruptions.shade", [0.5, 1.5], ""),
        ("corruptions.blur", [2, 1], ""),
        ("corruptions.noise", [0.0], ""),
        ("clutter", [1.5], ""),
        ("mislabelled", {"unknown": [0.1]}, ""),
        ("mislabelled.clearance", [], ""),
    ],
    "rule_families": [
        ("families", {"dwell": 0.1}, ""),
        ("families", {"margin": 0.0, "taste": 1.0}, ""),
        ("families.dwell", -0.1, ""),
        ("variants", ["nobody"], ""),
        ("averaged.members", 0, ""),
    ],
}


@pytest.mark.parametrize(("study", "row"), [(study, row) for study, rows in REFUSED.items() for row in rows], ids=str)
def test_settings_out_of_range_are_refused_by_name(study: str, row: tuple[str, object, str]):
    name, value, reason = row
    cfg = compose(["profile=smoke"])
    OmegaConf.set_struct(cfg, False)
    OmegaConf.update(cfg, f"studies.{study}.{name}", value, merge=False)
    with pytest.raises(ValueError, match=f"studies.{study}.{name}{reason}"):
        validate(cfg, [study])
