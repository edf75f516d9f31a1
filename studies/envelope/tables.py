"""The distances that the models learned, beside the users' true margins."""

import pandas as pd

from pipeline.report import style
from pipeline.report.study import Study
from pipeline.report.tables import Table


def envelopes(study: Study) -> Table:
    """Return the true distance and each shown model's, with the first one's interval; None where none was found.

    Scenes: the fewest and the most at a dose, of the first model.
    """
    table = study.table("envelope.csv", finite=("response",)).set_index(["variant", "user", "symbol"])
    shown = [variant for variant in ("clearance", "irl_ranked", "full") if variant in study.variants]
    scenes = study.table("curve.parquet").groupby(["variant", "user", "symbol"])["scenes"].agg(["min", "max"])
    rows, lengths = [], ["Truth", style.label(shown[0]), "low", "high", *map(style.label, shown[1:])]
    for user in study.judged_users:
        for symbol in dict.fromkeys(table.index.get_level_values("symbol")):
            row, first = {"User": user, "Item": symbol}, table.loc[shown[0], user, symbol]
            found = [first[name] for name in ("true_radius_m", "radius_m", "ci_low", "ci_high")]
            found += [table.loc[(variant, user, symbol), "radius_m"] for variant in shown[1:]]
            row |= {name: None if pd.isna(m) else m for name, m in zip(lengths, found, strict=True)}
            fewest, most = scenes.loc[(shown[0], user, symbol)]
            rows.append(row | {"Verdict": first["verdict"], "Scenes": f"{fewest}–{most}"})
    return Table(pd.DataFrame(rows, dtype=object), dict.fromkeys(lengths, "cm"))
