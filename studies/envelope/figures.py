"""Draw the effect of an item against a path's clearance from it [cm]."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import panels
from pipeline.report.study import Study

MODELS = ("full", "irl_ranked", "clearance")


def curves(study: Study) -> Figure:
    """Draw the effect of an added item against clearance: a row for each judged user, a panel for each symbol."""
    table = study.table("curve.parquet", finite=("response", "ci_low", "ci_high", "true_response"))
    users, symbols = study.judged_users, list(dict.fromkeys(table["symbol"]))
    figure, axes = panels(len(users), len(symbols), 3.15 * len(symbols), 2.9 * len(users), sharex=True, sharey=True)
    for line, user in zip(axes, users, strict=True):
        for panel, symbol in zip(line, symbols, strict=True):
            rows = table[(table["user"] == user) & (table["symbol"] == symbol)]
            truth = rows[rows["variant"] == "truth"]
            panel.plot(
                100 * truth["clearance_m"], truth["true_response"], color=style.INK, label="Truth", linewidth=1.4
            )
            for variant in (v for v in MODELS if v in study.variants):
                own = rows[rows["variant"] == variant]
                x = 100 * own["clearance_m"]
                panel.plot(x, own["response"], color=style.colour(variant), label=style.label(variant), linewidth=2)
                panel.fill_between(x, own["ci_low"], own["ci_high"], color=style.colour(variant), alpha=0.15)
            panel.set(title=f"{symbol}, {user} user", ylim=(-0.15, 1.1))
            panel.grid(axis="y")
    for panel in axes[-1]:
        panel.set_xlabel("clearance, cm")
    for panel in axes[:, 0]:
        panel.set_ylabel("fall in P(valid)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=10)
    return figure
