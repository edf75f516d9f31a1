"""The bolded table."""

from pipeline.report.bold import bold_table
from pipeline.report.page import Table
from pipeline.report.results import Results


def bold(results: Results) -> Table:
    """Return the paper's Table 2 by every source."""
    return bold_table(results.tables["bold"])
