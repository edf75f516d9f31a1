"""Settings of studies that make no sense are refused by name, before any work."""

import pytest

from pipeline.params import validate
from pipeline.world.layout import SYMBOLS
from tests.factories import composed, with_value

MARGINS = "{" + ", ".join(f"{symbol}: MARGIN" for symbol in SYMBOLS) + "}"
OUT_OF_RANGE = {  # study: values of its settings, each refused by the setting's name
    "acceptance": "variants=[unknown] | variants=[] | level=1.0 | fitted=20",
    "ceiling": "scenes={unknown: [20]} | scenes={irl_ranked: [20]} | scenes.full=[12, 6] | seeds={full: 2}"
    " | new_scenes=1 | seen_scenes=7 | batch=0 | growth=-0.5 | clear_cm=[4, 8]",
    "counterfactuals": "scenes=1 | move_step=0.0 | example_variant=best",
    "demonstrations": "seeds={clearance: 2} | seeds={full: 2, unknown: 2} | clear_cm=[4, 0] | clear_cm=[]",
    "envelope": "doses=1 | paths=0.5 | candidates=0 | step=0.0 | planner=unknown",
    "execution": "grip_m=0.0 | lattice=1 | physics_arm=pr3 | physics={walk: [full]} | physics.gradient=[unknown]"
    " | physics_starts=1000 | shown_scene=1000 | shaker.below_m=0.2 | arms.pr2.side_m=[] | arms.pr2.offset_m=[0.1]"
    " | solids.bowl.height_m=0.0",
    "identification": "paths=0 | draws=true | level=1.0",
    "perception": "pictures=0 | paths=0 | rendered=[] | headlines.taught_tops=train | headlines={}",
    "refutation": "scenes=3 | scenes=4.5 | far_m=0.04 | pieces=[3] | world.p_common_cause=1.5 | world.glasses=3"
    " | world.gap_m=[0.001, 0.04] | world.near_m=0",
    "solutions": "variants=[unknown] | variants=[] | split=seen_scenes | draws=0 | draws=10000 | neighbours=0",
    "shift": "scenes=1 | scenes=10000 | corruptions.blur=[2, 1] | corruptions={fog: [0.1]} | clutter=[1.5]"
    " | mislabelled={full: [0.1]} | mislabelled.clearance=[] | neighbour_m=-0.1",
}
WITH_REASON = [  # study, value, what the error says after the setting's name
    ("acceptance", "level=0.03", " = 0.03 among them"),
    ("acceptance", "levels=[0.2, 0.1]", ".*ascending numbers"),
    ("counterfactuals", "scenes=1000", ".*at most scenes.shared"),
    ("counterfactuals", "moved_scenes=7", ".*at most studies.counterfactuals.scenes"),
    ("counterfactuals", "split=seen_scenes", ".*new_scenes, new_items"),
    ("envelope", "clear_of_others=0.04", ".*more than the widest margin in users"),
    ("identification", "reported=[1, 1000]", ".*whole numbers from 1 to studies.identification.paths"),
    ("identification", "stranger=" + MARGINS.replace("MARGIN", "null"), ".*margins that no user has"),
    ("identification", "stranger=" + MARGINS.replace("MARGIN", "-1.0"), ".bowl"),
    ("identification", "split=seen_scenes", ".*new_scenes, new_items"),
]
ROWS = [(study, row, "") for study, rows in OUT_OF_RANGE.items() for row in rows.split(" | ")] + WITH_REASON


@pytest.mark.parametrize(("study", "row", "reason"), ROWS)
def test_settings_out_of_range_are_refused_by_name(study: str, row: str, reason: str):
    name = row.partition("=")[0]
    with pytest.raises(ValueError, match=f"studies.{study}.{name}{reason}"):
        validate(with_value(composed("profile=smoke"), f"studies.{study}.{row}"), [study])


def test_a_stranger_with_a_margin_to_an_unknown_symbol_is_refused():
    with pytest.raises(ValueError, match=r"stranger is \['mug'\]: expected some of bowl, plate"):
        validate(with_value(composed(), "studies.identification.stranger={mug: 0.045}"), ["identification"])
