"""The rows of a test that count: one loading branch, from the end of a slack on."""

import numpy as np

from .model import Table

_NEAR = 0.99  # share of the largest strain from which a branch counts as loaded in full


def kept(table: Table, which: np.ndarray) -> Table:
    """The rows of a table by numbers or flags `which`."""
    columns = {name: values[which] for name, values in table.columns.items()}
    return table._replace(columns=columns, rows=np.array(table.rows)[which].tolist())


def loading_branch(table: Table, runs: str) -> tuple[Table, list[str]]:
    """The rows up to the first turn of the column `runs`, and a sentence on those behind it. A
    table whose first branch ends before its largest values is given back whole."""
    size = np.abs(table.columns[runs] - table.columns[runs][0]) if table.rows else np.zeros(0)
    if not size.any():
        return table, []
    end = int(np.argmax(size >= _NEAR * size.max()))
    while end + 1 < len(size) and size[end + 1] > size[end]:
        end += 1
    if end + 1 == len(size) or np.any(np.diff(size[: end + 1]) <= 0):
        return table, []
    rows = table.rows
    words = (
        f"{runs} turns back behind row {rows[end]}: of the loop the loading branch is fitted, rows "
        f"{rows[0]} to {rows[end]}"
    )
    return kept(table, np.arange(end + 1)), [words]


def without_slack(table: Table, column: str, slack: float) -> Table:
    """The rows of a table with more than `slack` in a column, from which it counts there."""
    table = kept(table, table.columns[column] > slack)
    return table._replace(columns=table.columns | {column: table.columns[column] - slack})
