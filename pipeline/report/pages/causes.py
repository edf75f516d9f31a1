"""What the page on causes draws: one scene with each added item, and right verdicts."""

import pandas as pd
from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_map, draw_table, panels
from pipeline.report.results import Results
from pipeline.stats.tests import verdict
from pipeline.world.layout import SYMBOLS

SMALLEST = (0.02, 0.03, 0.04, 0.05, 0.06, 0.08)  # smallest effects of interest to compare
COUNTS = {f"{smallest:.2f}": "count" for smallest in SMALLEST}
VERDICTS = {"variant": "Model"} | {name: name for name in COUNTS}


def one_scene(results: Results) -> Figure:
    """Draw one scene without and with each added item: the image, the truth, and the shown models' maps."""
    drawn, shown = results.drawn, list(results.drawn.added_maps)
    columns = ["as it is", *(f"added {symbol}" for symbol in SYMBOLS)]
    figure, axes = panels(1 + len(shown), len(columns), 2.4 * len(columns), 2.5 * (1 + len(shown)))
    for i, title in enumerate(columns):
        draw_table(axes[0, i], drawn.added_images[i])
        axes[0, i].set_title(title)
        for j, name in enumerate(shown, 1):
            draw_map(axes[j, i], drawn.added_maps[name][i])
    for j, name in enumerate(shown, 1):
        axes[j, 0].set_ylabel(style.label(name), color=style.INK)
    return figure


def score(results: Results) -> pd.DataFrame:
    """Return each model's number of right verdicts on added items and on changes of user, and those of no image."""
    rows = [(v, results.verdicts_right(v), results.verdicts_right(v, "user")) for v in results.variants]
    rows.append(("A model that never sees the image", results.image_blind_right(), results.image_blind_right("user")))
    rows.append(("Questions", results.questions(), results.questions("user")))
    return pd.DataFrame(rows, columns=["variant", "added", "user"])


def sensitivity(results: Results) -> pd.DataFrame:
    """Return each model's number of right verdicts on added items for several smallest effects of interest.

    The truth stays as it is judged at the limit fixed in advance.
    """
    rows = []
    for variant in results.variants:
        asked = results.asked("add", variant)
        numbers = list(asked[["effect", "p_holm", "ci90_low", "ci90_high"]].itertuples(index=False))
        given = {s: [verdict(*x, smallest=s) for x in numbers] for s in SMALLEST}
        rows.append(
            {"variant": variant} | {f"{s:.2f}": sum(asked["truth_verdict"] == said) for s, said in given.items()}
        )
    return pd.DataFrame(rows)
