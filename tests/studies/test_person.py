"""Study person: a simulated person follows the margins given, and habits spoil answers as they say."""

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng as rng

from pipeline.causal.experiment import NEAR_M, STICKER, UNCHANGED
from studies.person.designed import CHOICES, labels
from studies.person.people import Person
from studies.person.stage import asked, coverage, designed, false_effects

NEAR = np.linspace(0.0005, NEAR_M, 400)
ALL = np.full(400, "cup")


def test_a_rule_refuses_within_the_margin_and_nothing_else():
    person = Person({"cup": 0.02})
    assert (person.accepts(rng(0), ALL, NEAR, np.full(400, 0.05)) == (NEAR > 0.02)).all()
    assert person.accepts(rng(0), np.full(400, UNCHANGED), NEAR, np.full(400, 0.05)).all()
    assert person.true_effects(rng(1), 4000) == {"cup": pytest.approx(-0.5, abs=0.03), STICKER: 0.0}


@pytest.mark.parametrize(
    ("habits", "share"),
    [({"lapses": 1.0, "accepting": 0.9}, 0.9), ({"compositing": 0.3}, 0.7), ({"drift_m": 0.02}, 0.62)],
)
def test_a_habit_changes_the_share_that_is_accepted_as_it_says(habits: dict, share: float):
    answers = Person({"cup": 0.0}, **habits).accepts(rng(2), ALL, np.full(400, 0.05), np.full(400, 0.05))
    assert answers.mean() == pytest.approx(share, abs=0.06)


def test_tables_count_people_and_kinds():
    table = asked(6, ("any", Person({"cup": 0.045, "fork": 0.0}, lapses=0.05), (1, "a"))).assign(person=0)
    assert coverage(table).set_index("look").loc["all", "intervals"] == 2
    assert false_effects(table.assign(verdict="effect")).iloc[0][["people", "false"]].tolist() == [1, 1.0]


@pytest.mark.slow
def test_designed_tables_tell_a_rule_in_fewer_labels_than_random_ones():
    jobs = pd.DataFrame([(choice, person) for choice in CHOICES for person in range(4)], columns=["choice", "person"])
    counts = [labels(choice, 2, [0.0, 0.02, 0.045], 8, 0.0, rng(person)) for choice, person in jobs.to_numpy()]
    table = designed(jobs, counts).set_index("choice")
    assert table.loc["designed", "median"] <= table.loc["random", "median"] / 2
    assert table.loc["designed", "known"] == 1 and table["people"].tolist() == [4, 4]
