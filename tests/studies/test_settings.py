"""Settings of studies that make no sense are refused by name, before any work."""

import pytest

from pipeline.params import validate
from pipeline.runtime.errors import InputError
from tests.factories import composed, with_value

WRONG = {  # study: values of its settings, each refused by the setting's name
    "counterfactuals": "scenes=1000 | split=seen_scenes",
    "execution": "grip_m=0.0 | physics={walk: [full]} | shown_scene=1000 | shaker.below_m=0.2",
    "fairness": "scenes={full: [20]} | scenes.full=[12, 6] | scenes_seeds=1 | seen_scenes=7",
    "users": "draws=0 | samples=0 | samples=1000 | neighbours=0",
    "perception": "pictures=0 | rendered=[] | headlines.taught_tops=train",
    "refutation": "scenes=3 | far_m=0.04 | pieces=[3]",
    "assumptions": "faded=[0.5, 0.2] | gap_m=[0.0] | world.gap_m=[0.001, 0.04] | world.glasses=3 | "
    "world.doses=[0, 0.5]",
    "person": "people=1 | kinds=[glass] | sorts={} | most.lapses=2.0 | careful.lapses=[0.1]",
    "safety": "envelope.doses=1 | envelope.planner=unknown | envelope.clear_of_others=0.04 | acceptance.variants=[] | "
    "acceptance.level=1.0 | acceptance.fitted=20 | acceptance.levels=[0.2, 0.1] | acceptance.levels=[0.1]",
    "shift": "scenes=10000 | corruptions.blur=[2, 1] | corruptions={fog: [0.1]} | mislabelled={full: [0.1]}",
}
ROWS = [(study, row) for study, rows in WRONG.items() for row in rows.split(" | ")]


@pytest.mark.parametrize(("study", "row"), ROWS)
def test_a_setting_that_makes_no_sense_is_refused_by_name(study: str, row: str):
    with pytest.raises(InputError, match=f"studies.{study}.{row.partition('=')[0]}"):
        validate(with_value(composed("profile=smoke"), f"studies.{study}.{row}"), [study])
