"""Power of the causal procedure: how often an effect of a given size is called one, and how often it is denied."""

from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from pipeline.report.style import INK, MUTED, colour, marker
from pipeline.report.wording import variant_label

STYLISED = ("P", "X", "d", "*")  # markers of regimes that are no variant's


def draw(regimes: dict[str, dict], measured: list[str], smallest: float, columns: int) -> Figure:
    """A panel per verdict, "effect" and "no effect": its share against the true effect, a line a regime."""
    size = (6.4, 3.5) if columns > 1 else (4.2, 6.4)
    figure = Figure(size, layout="constrained")
    axes = figure.subplots(2 // columns, columns, sharex=True, sharey=True, squeeze=False).ravel()
    marks = iter(STYLISED * len(regimes))
    for name, regime in regimes.items():
        own = name in measured
        style = {"color": colour(name), "marker": marker(name)} if own else {"color": MUTED, "marker": next(marks)}
        for ax, verdict in zip(axes, ("effect", "no effect"), strict=True):
            effects, shares = zip(*sorted((float(e), by[verdict]) for e, by in regime["power"].items()), strict=True)
            label = variant_label(name) if own else name
            ax.plot(effects, shares, ms=4, lw=1.2, ls="-" if own else (0, (4, 2)), label=label, **style)
            ax.set_title(f"Verdict “{verdict}”", loc="left")
    for ax in axes:
        ax.axvline(smallest, color=INK, lw=0.6)
        ax.set(ylim=(-0.03, 1.03), xlabel="true effect on mean P(valid)")
        ax.xaxis.set_major_locator(MultipleLocator(smallest))
        ax.grid()
    axes[0].set_ylabel("share of simulated families")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4 if columns > 1 else 2, handlelength=2.4)
    return figure
