"""Stage sealed: set what was expected of each headline beside what came.

expectations.csv was written before the sealed tests were opened: headline, expected, low and high (an interval, empty
for a claim's verdict), why. Headlines are those of reports/metrics.json and of study perception. surprises.csv was
written afterwards: headline, what came, and what we know of the reason.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import read_json, read_table, write_table
from pipeline.launch import launch

EXPECTATIONS = Path(__file__).with_name("expectations.csv")
SURPRISES = Path(__file__).with_name("surprises.csv")


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write numbers.csv and claims.csv: the columns of expectations.csv, `found`, and whether it was as expected.

    A headline that this run does not have, such as that of a dropped variant, is left out.
    """
    paper, perception = Path(cfg.paths.report), Path(cfg.paths.studies) / "perception"
    found = dict(flat(read_json(paper / "metrics.json") | read_json(perception / "metrics.json")))
    table = read_table(EXPECTATIONS)
    table = table[table["headline"].isin(found)].assign(found=table["headline"].map(found))
    is_claim = table["headline"].str.startswith("claims.")
    claims, numbers = table[is_claim].drop(columns=["low", "high"]), table[~is_claim]
    numbers = numbers.assign(**{name: pd.to_numeric(numbers[name]) for name in ("expected", "low", "high", "found")})
    within = numbers["found"].between(numbers["low"], numbers["high"])
    numbers = numbers.assign(as_expected=within)
    claims = claims.assign(as_expected=claims["found"] == claims["expected"])
    write_table(out_dir / "numbers.csv", numbers)
    write_table(out_dir / "claims.csv", claims)
    write_table(out_dir / "surprises.csv", surprises_of(numbers, claims, read_table(SURPRISES)))


def surprises_of(numbers: pd.DataFrame, claims: pd.DataFrame, written: pd.DataFrame) -> pd.DataFrame:
    """Return headline, expected, found and explanation of all that was not as expected.

    An explanation was written for one value, three decimals of it; where another came, it is missing.
    """
    both = pd.concat([numbers.assign(found=numbers["found"].map("{:.3f}".format)), claims])
    both = both.loc[~both["as_expected"], ["headline", "expected", "found"]].astype(str)
    return both.merge(written.astype(str), on=["headline", "found"], how="left")


def flat(nested: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each headline's name, joined by dots, and its value."""
    for name, value in nested.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{before}{name}.")
        else:
            yield before + name, value


if __name__ == "__main__":
    launch(main, "sealed")
