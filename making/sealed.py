"""Root seeds of the sealed draws, by SHA-256 of what was expected of their results: so that file came first.

python -m making.sealed    print each draw, the seed that it has and the seed that it must have
"""

import hashlib
import re

import pandas as pd
import yaml

from making.data.unseen import SEED
from pipeline.runtime.places import ROOT
from pipeline.runtime.streams import job_seed

EXPECTATIONS = ROOT / "docs/expectations.csv"  # headline, expected, low, high, why; committed before anything is drawn


def sealed_seed(expectations: bytes, draw: str) -> int:
    """Return the root seed, below 2**31, of one draw: it depends on the draw's name and each byte of the expectations.

    Training sets, "seeds.0" to "seeds.9", have ten seeds in a row from 1000 to 10999.
    """
    name, _, place = draw.partition(".")
    seed = job_seed(hashlib.sha256(expectations).hexdigest(), name if name == "seeds" else draw)
    return 1000 + seed % 1000 * 10 + int(place) if name == "seeds" else seed % 2**31


def drawn() -> dict[str, int]:
    """Return the seed that each draw has: training sets, root seeds of params.yaml, data/, pictures."""
    params = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
    seeds = {f"seeds.{place}": seed for place, seed in enumerate(params["seeds"])}
    seeds["unseen_items_and_table_tops"] = SEED
    for name, value in pd.json_normalize(params).iloc[0].items():
        if str(name).rpartition(".")[2] in ("root_seed", "paths_seed"):
            seeds[str(name)] = int(value)
    for split in ("test_taught", "test_held_out"):
        source = (ROOT / "rendered/pictures" / split / "SOURCE.md").read_text(encoding="utf-8")
        seeds[split] = int(re.findall(r"--seed (\d+)", source)[0])
    return seeds


if __name__ == "__main__":
    expectations = EXPECTATIONS.read_bytes()
    for draw, seed in drawn().items():
        print(draw, seed, sealed_seed(expectations, draw))
