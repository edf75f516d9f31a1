"""The difference of two commits: paired over seeds, with one word a headline."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_rel

from pipeline.audit.__main__ import main
from pipeline.audit.difference import METRICS, Commit, Difference, _processors, paired
from pipeline.audit.text import of_difference, of_rerun
from pipeline.git import git
from pipeline.runtime.places import PROCESSORS

AUTHOR = ("-c", "user.name=tests", "-c", "user.email=tests@localhost")
RNG = np.random.default_rng(3)


def seeds(**values: np.ndarray) -> pd.DataFrame:
    rows = [(name, seed, value) for name, column in values.items() for seed, value in enumerate(column)]
    return pd.DataFrame(rows, columns=["headline", "seed", "value"])


def test_each_headline_gets_its_word():
    base, noise = RNG.normal(0.8, 0.02, 10), RNG.normal(0, 0.001, 10)
    far = RNG.normal(0, 0.05, 10)
    before = seeds(better=base, worse=base, same=base, undecided=base)
    after = seeds(better=base + 0.1 + noise, worse=base - 0.1 + noise, same=base + noise, undecided=base + far)
    words = paired(before, after).set_index("headline")["word"]
    assert dict(words) == {word: word for word in ("better", "worse", "same", "undecided")}


def test_the_interval_is_that_of_scipys_paired_test():
    before, after = RNG.normal(0, 1, (2, 10))
    row = paired(seeds(x=np.append(before, 0.0)), seeds(x=np.append(after, np.nan))).iloc[0]  # a seed without a value
    test = ttest_rel(after, before)
    assert row["p_holm"] == pytest.approx(test.pvalue)
    assert (row["ci_low"], row["ci_high"]) == pytest.approx(tuple(test.confidence_interval()))


def test_a_commit_does_not_differ_from_itself(capsys: pytest.CaptureFixture[str]):
    assert main(["HEAD", "HEAD"]) == 0
    said = capsys.readouterr().out
    assert "Verdicts that changed: 0." in said and said.count("\n## ") == said.count("\n## Headlines, paired by seed")


def test_stages_that_ran_on_another_processor_are_named(tmp_path: Path):
    def commit(**processors: str) -> Commit:
        (tmp_path / PROCESSORS).write_text(json.dumps(processors))
        git(tmp_path, "add", "--all")
        git(tmp_path, *AUTHOR, "commit", "--quiet", "--message", "ran")
        return Commit(git(tmp_path, "rev-parse", "HEAD").strip(), tmp_path)

    git(tmp_path, "init", "--quiet")
    (tmp_path / PROCESSORS).parent.mkdir()
    before = commit(scenes="Xeon", train="Xeon", irl="EPYC")
    after = commit(scenes="EPYC", train="EPYC", irl="EPYC", repair="EPYC")
    assert _processors(before, after) == [("Xeon", "EPYC", "scenes, train")]


def test_names_that_only_one_commit_has_are_counted_and_not_listed():
    headlines = [("kept", 0.1, 0.2, 0.1), ("gone", 0.1, None, None), ("new", None, 0.2, None)]
    nothing = Difference([], headlines, [("emptied", 3, "null")], [], [], [], pd.DataFrame())
    text = of_difference("before", "after", nothing)
    assert "| `kept` | 0.1 | 0.2 | 0.1 |\n\nOnly before: 1. Only after: 1." in text
    assert "gone" not in text and "| `emptied` | 3 | null |" in text


def test_a_stage_that_ran_again_with_other_bytes_is_not_called_equal_by_headlines_that_did_not_run():
    same = pd.DataFrame({"headline": ["x"], "word": ["same"], "difference": [0.0], "ci_low": [0.0], "ci_high": [0.0]})
    difference = Difference([], [], [], [], [], [], same)
    for path, word in (("outputs/scenes/images.npz", "changed"), (METRICS, "equal")):
        assert of_rerun("scenes", {("scenes", path): False}, difference).startswith(f"# scenes: {word}\n")


def test_an_audit_says_that_pairs_are_too_few():
    by_seed = paired(seeds(x=np.array([0.5, 0.6]), y=np.ones(2)), seeds(x=np.array([0.575, 0.675]), y=np.ones(2)))
    text = of_difference("before", "after", Difference([], [], [], [], [], [], by_seed))
    assert "+0.075 (too few pairs)" in text and "Others with the same values for every seed: 1." in text
